"""Measure all repetitions of a lab, without its twins; what is kept in the folder of results is not measured again."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rigtwin.compare import result_files
from rigtwin.compare.chosen import chosen, known_scatter
from rigtwin.compare.deviation import ONLY_MEASURED, Deviation, deviations
from rigtwin.compare.kept_measurements import FOLDER as KEPT
from rigtwin.compare.measure_repetitions import Failure, Measured, folders, measuring
from rigtwin.compare.preflight import need_fitting_media, refused_twins
from rigtwin.compare.twins.matched import set_by_hand
from rigtwin.lab.file.lab_file import Lab, read_lab
from rigtwin.lab.formatting import counted, few_of
from rigtwin.lab.output_files import remove_leftovers
from rigtwin.lab.progress import Progress, silent

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True)
class LabMeasurements:
    """What the repetitions of a lab gave."""

    lab: Lab
    measured: tuple[Measured, ...]
    """By experiment, in the order of the lab file."""
    files: dict[str, Path] = field(default_factory=dict)
    remarks: tuple[str, ...] = ()
    new: int = 0
    """Number of repetitions that were measured, not taken from what is kept."""
    refused: int = 0
    """Number of repetitions that were to be measured and could not be."""

    @property
    def headline(self) -> str:
        """How many repetitions were measured and how many are kept, in one sentence; empty where there are none."""
        kept = sum(len(one.measurements) + len(one.failures) for one in self.measured) - self.new - self.refused
        parts = [
            f"{counted(self.new, 'repetition')} measured",
            *([f"{self.refused} refused"] if self.refused else []),
            *([f"{kept} kept from before; --again measures all"] if kept else []),
        ]
        return f"{', '.join(parts)}." if self.new or self.refused or kept else ""

    def __repr__(self) -> str:
        names = ", ".join(one.experiment.id for one in self.measured)
        return f"<LabMeasurements of {self.lab.title!r}: {names}; {len(self.rows)} numbers: to_frame()>"

    @property
    def rows(self) -> list[dict[str, Any]]:
        """Every quantity of every repetition, and those that lab.toml states."""
        return [row for one in self.measured for row in one.observations(self.lab)]

    @property
    def means(self) -> tuple[Deviation, ...]:
        """The repetitions of each experiment combined, with the scatter that `compare` uses; not simulated."""
        return tuple(
            row
            for one in self.measured
            for row in deviations(
                one.experiment.id,
                one.experiment.rig_name,
                one.quantities,
                (),
                set_from=set_by_hand(one.experiment),
                without_twin=ONLY_MEASURED,
                scatter=partial(known_scatter, one.experiment),
                failed_checks=one.failed_beside,
            )
        )

    @property
    def warnings(self) -> list[str]:
        """Remarks on the whole run, and the warnings of each experiment with its name."""
        return [*self.remarks, *(f"{one.experiment.id}: {each}" for one in self.measured for each in one.warnings)]

    def to_frame(self) -> pd.DataFrame:
        """Return every quantity of every repetition as a table.

        Returns
        -------
        pandas.DataFrame
            The columns of ``measurements.csv``.
        """
        import pandas as pd

        return pd.DataFrame(self.rows, columns=list(result_files.OBSERVATION_COLUMNS))

    def to_json(self) -> dict[str, Any]:
        """The document of `rigtwin measure LAB --json`."""
        return {
            "title": self.lab.title,
            "lab": str(self.lab.path.resolve()),
            "experiments": [one.to_json() for one in self.measured],
            "files": {name: str(path) for name, path in self.files.items()},
        }


def measure_lab(
    lab_folder: Path,
    out: Path,
    progress: Progress = silent,
    *,
    only: Sequence[str] | None = None,
    workers: int | None = None,
    again: bool = False,
    allow_outside: bool = False,
) -> LabMeasurements:
    """Measure all repetitions of a lab and write the results.

    Parameters
    ----------
    lab_folder : Path
        Folder with a lab.toml.
    out : Path
        Folder for measurements.csv, measurements.json and pictures; `rigtwin.compare.compare_lab.compare` uses what is
        kept there.
    progress : Progress
        Called with step, number and count.
    only : sequence of str, optional
        Names of the experiments; all by default.  The tables show the others, too, if all their repetitions are kept
        in `out` as they are now.
    workers : int, optional
        Number of measuring processes, one for each core by default.
    again : bool
        Whether repetitions are measured again that are kept in `out`.
    allow_outside : bool
        Whether the lab may name files outside its folder.

    Returns
    -------
    LabMeasurements
        Measurements by experiment, with the repetitions that could not be measured.

    Raises
    ------
    BadLabFile
        If lab.toml is not valid, rejects all repetitions of an experiment, or states what none of them fits.
    BadInput
        If no repetition of any experiment can be measured.
    """
    lab = read_lab(lab_folder, allow_outside=allow_outside)
    experiments = chosen(lab, only)
    need_fitting_media(lab, experiments)
    with result_files.claimed(out):
        for place in (*folders(lab.experiments), KEPT):
            remove_leftovers(out / place)
        with measuring(lab.experiments, out, workers, again=again, only=experiments) as pending:
            found: Mapping[str, Measured] = pending.results(progress)
        named = tuple(found[one.id] for one in experiments)
        if not any(one.known for one in named):
            for one in named:
                one.need_known()
        remarks = (*_not_in_tables(lab, found), *refused_twins(lab, experiments))
        refused = sum(isinstance(job.result(), Failure) for job in pending.started)
        new = len(pending.started) - refused
        done = LabMeasurements(lab, named, remarks=remarks, new=new, refused=refused)
        whole = replace(done, measured=tuple(found[one.id] for one in lab.experiments if one.id in found))
        names = ("measurements.csv", "measurements.json")
        done.files.update({name: out / name for name in names})
        contents = {
            "measurements.csv": result_files.table(whole.rows, result_files.OBSERVATION_COLUMNS),
            "measurements.json": result_files.document(whole.to_json()),
        }
        result_files.write_together(out, contents)
    return done


def _not_in_tables(lab: Lab, found: Mapping[str, Measured]) -> Iterator[str]:
    """A remark on the experiments that are not named and not kept as they are now."""
    if missing := [one.id for one in lab.experiments if one.id not in found]:
        yield (
            f"{few_of(missing)}: not in measurements.csv and measurements.json, because not every "
            "repetition is kept as it is now; `rigtwin measure` of the whole lab adds what is missing"
        )
