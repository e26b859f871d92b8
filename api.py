"""The Python API: the commands of the command line as functions.

``rigtwin.measure``, ``rigtwin.simulate`` and ``rigtwin.open_lab`` take the options of the commands of the same names as
keyword arguments, as text with a unit (``"6.2 mm"``) or as a number in SI units.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, get_args, get_origin

from rigtwin.lab.errors import BadInput, rename_options, reworded_refusals
from rigtwin.lab.rigs import RIGS, RigName
from rigtwin.lab.spelling import meant_or

if TYPE_CHECKING:
    from rigtwin.commands.run_command import Work
    from rigtwin.compare.campaign.calibration import Calibration
    from rigtwin.compare.comparison import Comparison
    from rigtwin.compare.diagnose.bulk.diagnose_bulk import BulkDiagnosis
    from rigtwin.compare.diagnose.diagnosis import Diagnosis
    from rigtwin.compare.measure_lab import LabMeasurements
    from rigtwin.compare.twins.twin import Twin
    from rigtwin.lab.file.lab_file import Lab
    from rigtwin.lab.progress import Progress
    from rigtwin.lab.quantity import Measurement

Setting = str | float | int | Path | Sequence[str | Path] | None


def measure(
    rig: RigName,
    *media: str | Path | Sequence[str | Path],
    out: str | Path | None = None,
    progress: Progress | None = None,
    **settings: Setting,
) -> Measurement:
    """Measure one rig from its media.

    Parameters
    ----------
    rig : str
        The rig that the media show, one of `rigtwin.lab.rigs.RIGS`.
    *media : str, pathlib.Path or sequence of these
        One clip, or one or more photos of the same bed or heap.
    out : str or pathlib.Path, optional
        Folder for overlay pictures, plot, record and ``NAME-measurement.json``.  Without it none are made.
    progress : callable, optional
        Called as ``progress(stage, done, total)``.
    **settings : str, float, int, pathlib.Path, sequence of str or None
        Options of ``rigtwin measure RIG`` with underscores: ``frame_rate="240 Hz"``, ``bead_diameter="6.2 mm"``.
        Text carries a unit; a number is in SI units.

    Returns
    -------
    rigtwin.lab.quantity.Measurement
        Quantities with standard uncertainties, checks, warnings and the records behind them.

    Raises
    ------
    rigtwin.lab.errors.BadInput
        If a setting is unknown, misses its unit or cannot be.
    rigtwin.lab.errors.UnreadableMedia
        If a file is no video or photo.
    rigtwin.lab.errors.NothingToMeasure
        If the media do not show the rig's experiment.

    Examples
    --------
    >>> import rigtwin
    >>> from pathlib import Path
    >>> clip = Path(rigtwin.__file__).parent / "sample_media" / "drop" / "r01.mp4"
    >>> m = rigtwin.measure("drop", clip, frame_rate="240 Hz", bead_diameter="6.2 mm")
    >>> round(m.value("restitution_wall", method="velocity", bounce=1), 2)
    0.41
    """
    from rigtwin.commands import measure as commands
    from rigtwin.commands.output_folder import check_own, claimed, keep
    from rigtwin.commands.run_command import media_of
    from rigtwin.lab.progress import silent

    if rig not in RIGS:
        raise _unknown("rig", rig, RIGS)
    command = _command(commands.app, rig)
    several = (each if isinstance(each, (list, tuple)) else (each,) for each in media)
    paths = [_path("media", one) for each in several for one in each]
    positional = media_of(command)
    many = positional == "photos"
    if not paths:
        raise BadInput(f"measure {rig}: no media are given; give {'at least one photo' if many else 'one clip'}.")
    if len(paths) > 1 and not many:
        raise BadInput(f"{commands.one_clip(rig, len(paths))}.")
    work = _work(command, {positional: paths if many else paths[0]}, settings)
    folder = None if out is None else _path("out", out)
    measurement: Measurement
    if folder is None:
        measurement = _run(work, out=None, progress=progress or silent)
        return measurement
    with claimed(folder):
        _in_own_words(lambda: check_own(folder, rig, work.args[0]))
        measurement = _run(work, out=folder, progress=progress or silent)
        return keep(measurement, folder, work.args[0])


def simulate(rig: RigName | Literal["custom"], *, progress: Progress | None = None, **settings: Setting) -> Twin:
    """Run the digital twin of one rig.

    Parameters
    ----------
    rig : str
        The rig, one of `rigtwin.lab.rigs.RIGS`, or ``"custom"``: one of your own, whose ``lab`` is the lab.toml.
    progress : callable, optional
        Called as ``progress(stage, done, total)``.
    **settings : str, float, int, pathlib.Path or None
        Options of ``rigtwin simulate RIG`` with underscores: ``particle="D6"``, ``base_diameter="90 mm"``,
        ``count=900``.  Text carries a unit; a number is in SI units.

    Returns
    -------
    rigtwin.compare.twins.twin.Twin
        The simulated record, evaluated by the function that evaluates a filmed one.

    Raises
    ------
    rigtwin.lab.errors.BadInput
        If a setting is unknown, misses its unit or cannot be simulated.

    Examples
    --------
    >>> import rigtwin
    >>> twin = rigtwin.simulate("drop", particle="D6", wall="steel", drop_height="250 mm", restitution=0.5)
    >>> round(twin.value("restitution_wall", method="velocity", bounce=1), 2)
    0.5
    """
    from rigtwin.commands import simulate as commands
    from rigtwin.lab.progress import silent

    if rig not in (known := (*RIGS, "custom")):
        raise _unknown("rig", rig, known)
    twin: Twin = _run(_work(_command(commands.app, rig), {}, settings), progress=progress or silent)
    return twin


def open_lab(folder: str | Path, *, allow_outside: bool = False) -> OpenLab:
    """Read a lab folder and its ``lab.toml``, or open one with a ``lab.json`` of tracked repetitions.

    Parameters
    ----------
    folder : str or pathlib.Path
        The lab folder.
    allow_outside : bool
        Whether the lab may name files outside its folder.

    Returns
    -------
    OpenLab
        The lab, with `OpenLab.compare` and `OpenLab.diagnose`; of a ``lab.json`` the latter alone.

    Raises
    ------
    rigtwin.lab.errors.BadLabFile
        If ``lab.toml`` is missing or wrong; the message has the line.

    Examples
    --------
    >>> import rigtwin
    >>> from pathlib import Path
    >>> lab = rigtwin.open_lab(Path(rigtwin.__file__).parent / "sample_media")
    >>> [experiment.id for experiment in lab.experiments]
    ['drop-D6-steel', 'pendulum-D12', 'pile-D6-90mm']
    """
    return OpenLab(_path("folder", folder), allow_outside=allow_outside)


class OpenLab:
    """A lab folder that was read.

    Parameters
    ----------
    folder : pathlib.Path
        The lab folder.
    allow_outside : bool
        Whether the lab may name files outside its folder.
    """

    def __init__(self, folder: Path, *, allow_outside: bool = False) -> None:
        from rigtwin.lab.file.lab_file import read_lab

        self.folder = folder
        self.allow_outside = allow_outside
        tracked = (folder / "lab.json").is_file() and not (folder / "lab.toml").is_file()
        self.lab: Lab | None = None if tracked else read_lab(folder, allow_outside=allow_outside)

    def __repr__(self) -> str:
        content = ", ".join(one.id for one in self.experiments) if self.lab else "tracked repetitions"
        return f"<OpenLab {self.folder}: {content}>"

    @property
    def experiments(self) -> tuple[Any, ...]:
        """The experiments of lab.toml, in its order; none of a lab.json."""
        return tuple(self.lab.experiments) if self.lab else ()

    def compare(
        self,
        *,
        out: str | Path | None = None,
        only: str | Sequence[str] = (),
        workers: int | None = None,
        progress: Progress | None = None,
        **settings: Setting,
    ) -> Comparison:
        """Measure every experiment, run its twin and set the two side by side.

        Parameters
        ----------
        out : str or pathlib.Path, optional
            Folder for tables, report and provenance; ``out`` in the lab folder by default.
        only : str or sequence of str, optional
            Ids of the experiments to take; all by default.
        workers : int, optional
            Number of measuring processes, one for each core by default.
        progress : callable, optional
            Called as ``progress(stage, done, total)``.
        **settings : str, float, int, pathlib.Path or None
            Options of ``rigtwin compare`` with underscores: ``runs=3``, ``model="model.toml"``, ``rolling_model="A"``.

        Returns
        -------
        rigtwin.compare.comparison.Comparison
            Percent deviations; ``to_frame()`` gives them as a table.

        Raises
        ------
        rigtwin.lab.errors.BadInput
            If a setting is unknown or cannot be, or no repetition of an experiment can be measured.
        """
        from rigtwin.commands import labs
        from rigtwin.lab.progress import silent

        work = _work(
            _inner(labs.compare),
            {"lab": self.folder},
            {"out": out, "only": only, "allow_outside": self.allow_outside, **settings},
        )
        comparison: Comparison = _run(work, workers=workers, progress=progress or silent)
        return comparison

    def measure(
        self,
        *,
        out: str | Path | None = None,
        only: str | Sequence[str] = (),
        workers: int | None = None,
        again: bool = False,
        progress: Progress | None = None,
    ) -> LabMeasurements:
        """Measure all repetitions, without twins.

        Parameters
        ----------
        out : str or pathlib.Path, optional
            Folder for tables and pictures; ``out`` in the lab folder by default.
        only : str or sequence of str, optional
            Ids of the experiments to take; all by default.
        workers : int, optional
            Number of measuring processes, one for each core by default.
        again : bool
            Whether repetitions are measured again that are kept in `out`.
        progress : callable, optional
            Called as ``progress(stage, done, total)``.

        Returns
        -------
        rigtwin.compare.measure_lab.LabMeasurements
            ``to_frame()`` gives every quantity of every repetition as a table.
        """
        from rigtwin.commands import measure
        from rigtwin.lab.progress import silent

        work = _work(
            _inner(measure.measure_lab),
            {"lab": self.folder},
            {"out": out, "only": only, "workers": workers, "again": again, "allow_outside": self.allow_outside},
        )
        measured: LabMeasurements = _run(work, progress=progress or silent)
        return measured

    def calibrate(
        self,
        *,
        out: str | Path | None = None,
        workers: int | None = None,
        progress: Progress | None = None,
        **settings: Setting,
    ) -> Calibration:
        """Find one set of parameters for all experiments with many particles, as a posterior.

        Parameters
        ----------
        out : str or pathlib.Path, optional
            Folder for results; ``calibration`` in the lab folder by default.
        workers : int, optional
            Number of processes of this machine, one for each core by default.
        progress : callable, optional
            Called as ``progress(stage, done, total)``.
        **settings : str, float, int, sequence of str or None
            Options of ``rigtwin calibrate`` with underscores: ``fit=["static_friction"]``, ``hold_out=["hopper"]``.

        Returns
        -------
        rigtwin.compare.campaign.calibrate.Calibration
            Best set, samples of the posterior in SI, intervals, correlations and predictions.

        Raises
        ------
        rigtwin.lab.errors.BadInput
            If a setting is unknown, or there is nothing to fit.
        """
        from rigtwin.commands import calibrate
        from rigtwin.lab.progress import silent

        work = _work(
            _inner(calibrate.calibrate),
            {"lab": self.folder},
            {"out": out, "workers": workers, "allow_outside": self.allow_outside, **settings},
        )
        calibration: Calibration = _run(work, progress=progress or silent)
        return calibration

    def diagnose(
        self,
        *,
        out: str | Path | None = None,
        only: str | Sequence[str] = (),
        progress: Progress | None = None,
        **settings: Setting,
    ) -> Diagnosis | BulkDiagnosis:
        """Find where twin and measurement disagree, and which effect the model lacks.

        Parameters
        ----------
        out : str or pathlib.Path, optional
            Folder for results; ``out`` in the lab folder by default.
        only : str or sequence of str, optional
            Ids of the experiments to take; all by default.
        progress : callable, optional
            Called as ``progress(stage, done, total)``.
        **settings : str, pathlib.Path or sequence of these
            Options of ``rigtwin diagnose``: ``effect="my_effect.py"``, an effect of your own, or several.

        Returns
        -------
        rigtwin.compare.diagnose.diagnosis.Diagnosis
            The verdict, the named effects with their parameters, and the gap before and after.

        Raises
        ------
        rigtwin.lab.errors.BadInput
            If a setting is unknown, or the lab cannot be diagnosed.
        """
        from rigtwin.commands import labs
        from rigtwin.lab.progress import silent

        work = _work(
            _inner(labs.diagnose),
            {"lab": self.folder},
            {"out": out, "only": only, "allow_outside": self.allow_outside, **settings},
        )
        diagnosis: Diagnosis | BulkDiagnosis
        diagnosis, _files = _run(work, progress=progress or silent)
        return diagnosis


def _command(app: Any, rig: str) -> Callable[..., Work]:
    return _inner(next(command.callback for command in app.registered_commands if command.name == rig))


def _inner(command: Any) -> Callable[..., Work]:
    """The command's function with all options of its experiment, without those of the command line's output."""
    inner: Callable[..., Work] = command.__wrapped__
    return inner


def _work(command: Callable[..., Work], given: dict[str, Any], settings: dict[str, Any]) -> Work:
    parameters = inspect.signature(command, eval_str=True).parameters
    for name in settings:
        if name not in parameters or name in given:
            raise _unknown("setting", name, [known for known in parameters if known not in given])
    for name, parameter in parameters.items():
        if name in given:
            continue
        if name in settings and settings[name] is not None:
            given[name] = _in_own_words(partial(_read, name, settings[name], parameter))
        elif parameter.default is not inspect.Parameter.empty:
            given[name] = parameter.default
        else:
            raise BadInput(f"{name}: is missing; give it as a keyword argument.")
    work: Work = _in_own_words(lambda: command(**given))
    return work


def _run(work: Work, **more: Any) -> Any:
    from rigtwin.lab.quantity import reworded

    return _in_own_words(lambda: reworded(work(**more)))


def _path(name: str, value: Any) -> Path:
    if not isinstance(value, (str, Path)):
        raise BadInput(f"{name}: {value!r} is not the name of a file or folder.")
    return Path(value)


def _read(name: str, value: Any, parameter: inspect.Parameter) -> Any:
    """A setting as its command takes it: text through the option's own reader, a number in SI as it is."""
    kind, option = get_args(parameter.annotation)[:2]
    listed = next((get_args(each)[0] for each in get_args(kind) if get_origin(each) is list), None)
    if listed is not None:  # an option that may be repeated
        parser = getattr(option, "parser", None) or listed
        several = [value] if isinstance(_joined(value), (str, Path)) else value
        if not isinstance(several, Sequence):
            raise BadInput(f"{name}: {value!r} is neither a text nor a list of texts.")
        return [parser(str(_joined(each))) for each in several]
    kinds = (kind,) if get_origin(kind) in (None, Literal) else get_args(kind)
    if Path in kinds:
        path = _path(name, value)
        return path if getattr(option, "parser", None) is None else option.parser(str(value))
    if getattr(option, "parser", None) is not None:
        value = _joined(value)
        number = float in kinds and isinstance(value, (int, float)) and not isinstance(value, bool)
        return option.parser(float(value) if number else str(value))
    choices = next((get_args(each) for each in kinds if get_origin(each) is Literal), None)
    if choices is not None and value not in choices:
        raise _unknown(name, value, choices)
    if str in kinds and not isinstance(value, str):
        raise BadInput(f"{name}: {value!r} is not a text.")
    if bool in kinds and not isinstance(value, bool):
        raise BadInput(f"{name}: {value!r} is neither True nor False.")
    low, high = (getattr(option, end, None) for end in ("min", "max"))
    fits = isinstance(value, int) and not isinstance(value, bool)
    if int in kinds and not (fits and (low is None or value >= low) and (high is None or value <= high)):
        raise BadInput(f"{name}: {value!r} is not a whole number{_range(low, high)}.")
    return value


def _joined(value: Any) -> Any:
    """A tuple or list of numbers, the coordinates of a place, as the command line has it; others as they are."""
    numbers = isinstance(value, (tuple, list)) and bool(value) and all(isinstance(each, (int, float)) for each in value)
    return ",".join(str(each) for each in value) if numbers else value


def _range(low: int | None, high: int | None) -> str:
    """The range of a whole number in words; empty where it has none."""
    if low is None:
        return "" if high is None else f" up to {high}"
    return f" from {low} {'upwards' if high is None else f'to {high}'}"


def _in_own_words(call: Callable[[], Any]) -> Any:
    """Call; a refusal names the keyword argument where the command line names the option."""
    with reworded_refusals(partial(rename_options, instead=lambda name, value: f"{name}{value.replace(' ', '=', 1)}")):
        return call()


def _unknown(what: str, name: object, known: Sequence[str]) -> Exception:
    advice = meant_or(str(name), known, f"known are {', '.join(known)}.")
    return BadInput(f"{what}: there is no {name!r}; {advice}")
