"""The result of a comparison of a lab with its twins, and the warnings of each experiment."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rigtwin.compare.curve_overlays import Overlay
from rigtwin.compare.deviation import Deviation, summarized
from rigtwin.compare.measure_repetitions import Failure, Measured
from rigtwin.compare.twins.registry import entry_of
from rigtwin.compare.twins.twin import Twin
from rigtwin.lab.file.lab_file import Experiment, Lab
from rigtwin.lab.quantity import Measurement

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True)
class Outcome:
    """One experiment: its measurements, its twins and the deviations between them."""

    experiment: Experiment
    measurements: tuple[Measurement, ...]
    failures: tuple[Failure, ...]
    twins: tuple[Twin, ...]
    """The runs of its twin, with different seeds; empty where it has none."""
    deviations: tuple[Deviation, ...]
    shapes: tuple[Overlay, ...] = ()
    without_twin: str = ""
    """Why no twin is compared: it lacks something, or it failed."""
    lost_runs: Mapping[int, str] = field(default_factory=dict)
    """Why runs of its twin ended without a result, by seed, where others did not."""
    from_media: str = ""
    """Settings that the twin takes from the media, in words."""

    @property
    def measured(self) -> Measured:
        """What its repetitions gave."""
        return Measured(self.experiment, self.measurements, self.failures)

    @property
    def warnings(self) -> tuple[str, ...]:
        """All warnings of this experiment, each with the name of its file."""
        return (
            *((f"measured without a twin: {self.without_twin}",) if self.without_twin else ()),
            *_failed_runs(self),
            *self.measured.warnings,
            *entry_of(self.experiment).contradictions(self.experiment, self.measurements),
            *(
                f"twin: {warning}"
                for twin in self.twins
                if not twin.failed
                for warning in (*twin.warnings, *twin.evaluation.warnings)
            ),
        )


@dataclass(frozen=True)
class Comparison:
    """A whole lab compared with its twins."""

    lab: Lab
    outcomes: tuple[Outcome, ...]
    seed: int
    started: datetime
    seconds: dict[str, float] = field(default_factory=dict)
    """Wall-clock time [s] of each part of the run."""
    files: dict[str, Path] = field(default_factory=dict)
    remarks: tuple[str, ...] = ()
    """Remarks on the whole run."""

    def __repr__(self) -> str:
        return f"<Comparison of {self.lab.title!r}: {self.headline} {len(self.deviations)} rows: to_frame()>"

    @property
    def deviations(self) -> tuple[Deviation, ...]:
        """Deviations of all experiments, in the order of the lab file."""
        return tuple(row for outcome in self.outcomes for row in outcome.deviations)

    @property
    def headline(self) -> str:
        """How many rows have which verdict, in one sentence."""
        number = len(self.outcomes)
        compared = [row for row in self.deviations if row.z is not None and row.verdict != "set equal"]
        without = [one.experiment.id for one in self.outcomes if one.without_twin]
        lacking = f"; without a twin: {', '.join(without)}" if without else ""
        return f"{number} experiment{'s' if number != 1 else ''}, {summarized(compared)}{lacking}."

    def to_frame(self) -> pd.DataFrame:
        """Return the deviations as a table.

        Returns
        -------
        pandas.DataFrame
            The columns of ``deviations.csv``, one row for each quantity.
        """
        import pandas as pd

        return pd.DataFrame([row.row() for row in self.deviations])

    def to_json(self) -> dict[str, Any]:
        """The document of `rigtwin compare --json`."""
        return {
            "title": self.lab.title,
            "lab": str(self.lab.path.resolve()),
            "headline": self.headline,
            "deviations": [{**row.row(), "budget": row.budget} for row in self.deviations],
            "shapes": [shape.row(outcome.experiment.id) for outcome in self.outcomes for shape in outcome.shapes],
            "experiments": [_experiment_json(outcome) for outcome in self.outcomes],
            "borrowed": list(self.lab.borrowed),
            "particles_from_stl": list(self.lab.notes),
            "remarks": list(self.remarks),
            "files": {name: str(path) for name, path in self.files.items()},
        }


def _experiment_json(outcome: Outcome) -> dict[str, Any]:
    return {
        **outcome.measured.to_json(),
        "twins": [twin.to_json() for twin in outcome.twins],
        **({"without_twin": outcome.without_twin} if outcome.without_twin else {}),
        "warnings": list(outcome.warnings),
    }


def _failed_runs(outcome: Outcome) -> Iterator[str]:
    """A warning for each run of a twin that failed, where others did not."""
    for number, twin in enumerate(outcome.twins, start=1):
        if twin.failed and not outcome.without_twin:
            yield f"run {number} of the twin failed and is not compared: {twin.failed}"
    for seed, why in outcome.lost_runs.items():
        yield f"the run of the twin with seed {seed} failed and is not compared: {why}"
