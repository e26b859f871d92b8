"""Find impossible settings of a lab before anything is measured, simulated or written."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from rigtwin.compare.twins.registry import entry_of
from rigtwin.lab.errors import BadInput, TwinLacks, options_in
from rigtwin.lab.file.lab_file import Experiment, Fault, Lab, camera_key, faulty
from rigtwin.lab.file.option_names import in_keys
from rigtwin.lab.file.schema import keys_of_camera
from rigtwin.lab.file.toml_lines import Key
from rigtwin.lab.tracked.table import is_table


def preflight(lab: Lab, experiments: Sequence[Experiment], *, count: int | None) -> dict[str, str]:
    """Check that a repetition of each experiment fits its camera settings and that its twin can be run.

    Parameters
    ----------
    lab : Lab
        Lab whose experiments are checked.
    experiments : sequence of Experiment
        Its experiments that are compared.
    count : int or None
        Number of particles, where lab.toml states none.

    Returns
    -------
    dict of str to str
        By experiment why its twin cannot be run because something is neither stated nor known.

    Raises
    ------
    BadLabFile
        With all that is wrong.
    BadInput
        If a twin cannot have `count` particles.
    """
    lacking: dict[str, str] = {}
    faults: list[Fault] = []
    for experiment in experiments:
        if _all_rejected(experiment, faults):
            continue
        rate = _frame_rate(lab, experiment, faults)
        try:
            _need_known(lab, experiment)
            entry_of(experiment).check(experiment, model=lab.model, frame_rate=rate, count=count)
        except TwinLacks as error:
            lacking[experiment.id] = str(error).rstrip(".")
        except BadInput as error:
            faults.append(_of_twin(experiment, error, count))
    if faults:
        raise faulty(lab, faults)
    return lacking


def need_fitting_media(lab: Lab, experiments: Sequence[Experiment]) -> None:
    """Refuse experiments whose repetitions are all rejected, or none of which fits the camera.

    Parameters
    ----------
    lab : Lab
        Lab whose media are checked.
    experiments : sequence of Experiment
        Its experiments that are measured.

    Raises
    ------
    BadLabFile
        With all of these experiments.
    """
    faults: list[Fault] = []
    for experiment in experiments:
        if not _all_rejected(experiment, faults):
            _frame_rate(lab, experiment, faults)
    if faults:
        raise faulty(lab, faults)


def refused_twins(lab: Lab, experiments: Sequence[Experiment]) -> list[str]:
    """Return a warning for each experiment with stated sizes or numbers that its twin cannot have.

    Parameters
    ----------
    lab : Lab
        Lab of the experiments.
    experiments : sequence of Experiment
        Its experiments that are measured, without twins.

    Returns
    -------
    list of str
        Warnings, with the name of the experiment in front.
    """
    warnings = []
    for experiment in experiments:
        try:
            entry_of(experiment).check(experiment, model=lab.model, frame_rate=None, count=None)
        except TwinLacks:
            continue
        except BadInput as error:
            fault = _of_twin(experiment, error, None)
            key = f"{'.'.join(map(str, fault.key))}: " if fault.key else ""
            warnings.append(f"{experiment.id}: {key}{fault.why.rstrip('.')}; check this size, `compare` refuses it")
    return warnings


def _all_rejected(experiment: Experiment, faults: list[Fault]) -> bool:
    """Whether nothing is left to be measured and nothing is stated, which is then added to `faults`."""
    if not experiment.rejected or experiment.repetitions or experiment.measured:
        return False
    faults.append(Fault(experiment, ("files",), "all repetitions are rejected; accept one of them."))
    return True


def _of_twin(experiment: Experiment, error: BadInput, count: int | None) -> Fault:
    name, colon, why = str(error).partition(": ")
    if name == "count" and count is not None and entry_of(experiment).takes_count(experiment):
        raise BadInput(f"--count: {experiment.id}: the twin cannot be run: {why}") from None
    named = bool(colon) and name.isidentifier()
    return Fault(experiment, (name,) if named else (), f"the twin cannot be run: {why if named else error}")


def _need_known(lab: Lab, experiment: Experiment) -> None:
    """Raise `TwinLacks` with all parameters of contacts that are not known, or the start of a twin without media."""
    entry = entry_of(experiment)
    gaps = []
    for a, b in experiment.contacts:
        if missing := lab.model.known_contact(a, b).missing(entry.needed(experiment)):
            names = " and ".join(name.replace("_", " ") for name in missing)
            gaps.append(f"{names} of the contact {a}-{b} (give it under [contacts.{a}-{b}])")
    if gaps:
        raise TwinLacks(f"it needs the {', and the '.join(gaps)}.")
    if experiment.repetitions or entry.starts_from is None or entry.stated_start(experiment) is not None:
        return
    raise TwinLacks(
        f"it starts from the {entry.starts_from.replace('_', ' ')}, which is not stated, and there are no repetitions; "
        f"add {entry.starts_from} to the experiment."
    )


def _frame_rate(lab: Lab, experiment: Experiment, faults: list[Fault]) -> float | None:
    """Frame rate [1/s] of the experiment, if it is known; what of its media does not fit is added to `faults`."""
    try:
        return _need_view(lab, experiment)
    except _Misfit as misfit:
        faults.append(Fault(experiment, misfit.key, misfit.why))
        return None


class _Misfit(Exception):
    """Camera settings and media that do not fit each other."""

    def __init__(self, key: Key, why: str) -> None:
        super().__init__(why)
        self.key, self.why = key, why


def _need_view(lab: Lab, experiment: Experiment) -> float | None:
    """Check the camera settings against the media; returns the frame rate [1/s] if it is known.

    As in measuring, one repetition that fits is enough.  Media are opened only if needed, because a film must be read
    to its end for its timestamps.
    """
    camera = experiment.camera
    cameras = (camera, *experiment.cameras.values())
    stated = any(
        (one.region, one.start, one.end, one.exclude, one.known_length) != (None, None, None, (), None)
        for one in cameras
    )
    asked = camera.frame_rate is None and not entry_of(experiment).many_particles
    if not experiment.repetitions or (not stated and not asked):
        return camera.frame_rate
    first: _Misfit | None = None
    for views in experiment.repetitions:
        try:
            return _opened(lab, experiment, views)
        except _Misfit as misfit:
            first = first or misfit
    assert first is not None  # there are repetitions
    raise first


def _opened(lab: Lab, experiment: Experiment, views: Sequence[Path]) -> float | None:
    """Open the media of a repetition with its camera settings; returns the frame rate [1/s] of a film."""
    from rigtwin.measure.media.photo import read_photo
    from rigtwin.measure.media.sound import is_sound
    from rigtwin.measure.media.video import open_video

    rate = experiment.camera.frame_rate
    for view in views:
        camera = experiment.camera_of(view)
        if is_table(view) or is_sound(view):  # a tracked record has no pictures
            continue
        try:
            if entry_of(experiment).is_photo(view):
                read_photo(view, camera)
            else:
                rate = open_video(view, camera).frame_rate
        except BadInput as error:
            raise _misfit(lab, experiment, view, error) from None
    return rate


def _misfit(lab: Lab, experiment: Experiment, view: Path, error: BadInput) -> _Misfit:
    """The fault with the key that states what does not fit: that of the file, of all files, or the media."""
    why = in_keys(str(error), experiment.rig_name, experiment.particle_place)
    names = [name for name in options_in(str(error)) if name in keys_of_camera(experiment.rig_name)]
    # the message names start and end if the interval is too short, whichever is stated
    stated = filter(None, (camera_key(lab, experiment, view, name) for name in names))
    return _Misfit(next(stated, ("repetitions",)), why)
