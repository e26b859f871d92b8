"""Measure all repetitions of a lab, without its twins; what is kept in the folder of results is not measured again."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rigtwin.compare import result_files
from rigtwin.compare.chosen import chosen, known_scatter
from rigtwin.compare.deviation import Deviation, deviations
from rigtwin.compare.kept_measurements import FOLDER as KEPT
from rigtwin.compare.measure_repetitions import Measured, folders, measuring
from rigtwin.compare.preflight import need_fitting_media, refused_twins
from rigtwin.compare.twins.matched import set_by_hand
from rigtwin.lab.file.lab_file import Lab, read_lab
from rigtwin.lab.output_files import remove_leftovers
from rigtwin.lab.progress import Progress, silent

if TYPE_CHECKING:
    import pandas as pd

PART = (
    "measurements.csv and measurements.json hold the experiments named by --only; the others are kept and come back "
    "with the next `rigtwin measure` of the whole lab"
)


@dataclass(frozen=True)
class LabMeasurements:
    """What the repetitions of a lab gave."""

    lab: Lab
    measured: tuple[Measured, ...]
    """By experiment, in the order of the lab file."""
    files: dict[str, Path] = field(default_factory=dict)
    remarks: tuple[str, ...] = ()

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
                without_twin="only measured",
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
        Names of the experiments; all by default.
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
        for place in (*folders(experiments), KEPT):
            remove_leftovers(out / place)
        with measuring(experiments, out, workers, again=again) as pending:
            found: Mapping[str, Measured] = pending.results(progress)
        if not any(one.known for one in found.values()):
            for one in found.values():
                one.need_known()
        remarks = (*(() if len(experiments) == len(lab.experiments) else (PART,)), *refused_twins(lab, experiments))
        done = LabMeasurements(lab, tuple(found[one.id] for one in experiments), remarks=remarks)
        names = ("measurements.csv", "measurements.json")
        done.files.update({name: out / name for name in names})
        contents = {
            "measurements.csv": result_files.table(done.rows, result_files.OBSERVATION_COLUMNS),
            "measurements.json": result_files.document(done.to_json()),
        }
        result_files.write_together(out, contents)
    return done
