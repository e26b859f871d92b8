"""A lab compared with its twins: measure every repetition, run the matched twins, write deviations and a report.

::

    lab.toml ── measure all repetitions ──┐
        └────── run each rig's twin ──────┴── deviations ── observations.csv, deviations.csv/.json,
                                                            report.html, provenance.json
"""

from __future__ import annotations

import math
import statistics
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rigtwin.compare.curve_overlays import Overlay
from rigtwin.compare.deviation import MOMENTS, Deviation, group, key_of, over_views
from rigtwin.compare.measure_repetitions import Failure
from rigtwin.compare.twins.matched import (
    measured_start,
    stated_start,
)
from rigtwin.compare.twins.twin import Twin
from rigtwin.lab.file.lab_file import Experiment, Lab
from rigtwin.lab.formatting import reading, title
from rigtwin.lab.quantity import Measurement
from rigtwin.lab.records import Series
from rigtwin.lab.rigs import TiltSettings

if TYPE_CHECKING:
    import pandas as pd

    pass


OTHER_SPEED = 0.05  # relative, to which a plate's speed is usually set or read off

STRETCHES = 4  # of a plate's rise: with them its speed and how steady it is are known

LEAST_IN_STRETCH = 5  # frames, for a slope that one of them does not make


@dataclass(frozen=True)
class Outcome:
    """One experiment: what its repetitions measured, what its twin gave, how far apart they are."""

    experiment: Experiment
    measurements: tuple[Measurement, ...]
    failures: tuple[Failure, ...]
    twin: Twin
    deviations: tuple[Deviation, ...]
    more_runs: tuple[Twin, ...] = ()
    """Twins of many particles from further seeds."""
    shapes: tuple[Overlay, ...] = ()

    @property
    def twins(self) -> tuple[Twin, ...]:
        return (self.twin, *self.more_runs)

    @property
    def warnings(self) -> tuple[str, ...]:
        """All warnings of this experiment, each with the file it speaks of."""
        return (
            *(f"{failure.source.name} was left out: {failure.message}" for failure in self.failures),
            *(_with_source(item, warning) for item in self.measurements for warning in item.warnings),
            *_left_out(self.measurements),
            *_against_stated(self.experiment, self.measurements),
            *(f"twin: {warning}" for twin in self.twins for warning in (*twin.warnings, *twin.evaluation.warnings)),
        )


@dataclass(frozen=True)
class Comparison:
    """A whole lab beside its twins."""

    lab: Lab
    outcomes: tuple[Outcome, ...]
    seed: int
    started: datetime
    seconds: dict[str, float] = field(default_factory=dict)
    """[s], wall-clock time of each part of the run."""
    files: dict[str, Path] = field(default_factory=dict)
    remarks: tuple[str, ...] = ()
    """What is to be said of the whole run."""

    @property
    def deviations(self) -> tuple[Deviation, ...]:
        return tuple(row for outcome in self.outcomes for row in outcome.deviations)

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
            "deviations": [{**row.row(), "budget": row.budget} for row in self.deviations],
            "shapes": [shape.row(outcome.experiment.id) for outcome in self.outcomes for shape in outcome.shapes],
            "experiments": [_experiment_json(outcome) for outcome in self.outcomes],
            "borrowed": list(self.lab.borrowed),
            "remarks": list(self.remarks),
            "files": {name: str(path) for name, path in self.files.items()},
        }


def _experiment_json(outcome: Outcome) -> dict[str, Any]:
    return {
        "id": outcome.experiment.id,
        "rig": outcome.experiment.rig_name,
        "measurements": [item.to_json() for item in outcome.measurements],
        "failures": [{"file": str(item.source), "message": item.message} for item in outcome.failures],
        "twins": [twin.to_json() for twin in outcome.twins],
        "warnings": list(outcome.warnings),
    }


def _left_out(measurements: Sequence[Measurement]) -> Iterator[str]:
    """Doubtful repetitions that are in no mean, for there are sound ones."""
    seen = [(item.source.name, one) for item in measurements for one in over_views(item.quantities)]
    sound = {key for key, ones in group(one for _, one in seen).items() if not all(one.doubtful for one in ones)}
    lacking: dict[tuple[str, str], list[str]] = {}
    for source, one in seen:
        if one.doubtful and key_of(one) in sound and one.quantity not in MOMENTS:
            lacking.setdefault((source, one.doubtful), []).append(title(one.quantity))
    for (source, reason), names in lacking.items():
        yield f"{source} is doubtful and not in the mean of {', '.join(dict.fromkeys(names))}: {reason}"


def _against_stated(experiment: Experiment, measurements: Sequence[Measurement]) -> Iterator[str]:
    """Repetitions whose start is not the one that the lab file states: the wrong clip, scale, or a bounce not seen.

    And tilts at another speed.
    """
    if isinstance(experiment.rig, TiltSettings) and experiment.rig.speed is not None:
        yield from _against_speed(math.degrees(experiment.rig.speed), measurements)
    stated = stated_start(experiment)
    if stated is None:
        return
    for item in measurements:
        found = measured_start(experiment, item)
        if found is not None and abs(found.value - stated) > max(0.1 * stated, 3 * found.std_uncertainty):
            was, should = (reading(value, 0.0, found.unit) for value in (found.value, stated))
            yield (
                f"{item.source.name}: measured a {found.quantity.replace('_', ' ')} of {was} where the lab file states "
                f"{should}; an early part of the motion was missed, or clip, scale or setting are not those stated"
            )


def _against_speed(stated: float, measurements: Sequence[Measurement]) -> Iterator[str]:
    """Films whose plate rises at a rate that is never near the one that the lab file states [deg/s]."""
    for item in measurements:
        rates = [rate for angle in item.series if angle.quantity == "plate_angle" for rate in _rising(angle)]
        # a screw turned by hand changes its speed, and noise scatters what is seen of it: all parts must disagree
        if rates and not (1 - OTHER_SPEED) * min(rates) <= stated <= (1 + OTHER_SPEED) * max(rates):
            found = reading(statistics.fmean(rates), statistics.stdev(rates), "deg")
            yield (
                f"{item.source.name}: the plate rises by {found} per second where the lab file states a speed of "
                f"{stated:.3g} deg/s, at which the twin was run; correct the speed, or the camera's frame_rate, which "
                "the measured one goes with"
            )


def _rising(angle: Series) -> list[float]:
    """[deg/s] in equal stretches of the time in which the plate rises steadily; empty where too little is seen."""
    known = np.isfinite(angle.value)
    time, turned = angle.time[known], angle.value[known]
    if angle.unit == "rad":
        turned = np.degrees(turned)
    if len(time) < STRETCHES * LEAST_IN_STRETCH:
        return []
    # a plate that is filmed before it begins to turn, or after it has stopped, rises neither there nor near by
    low, high = turned.min(), turned.max()
    under_way = np.flatnonzero((turned > low + 0.2 * (high - low)) & (turned < high - 0.1 * (high - low)))
    if len(under_way) < STRETCHES * LEAST_IN_STRETCH:
        return []
    whole = np.arange(under_way[0], under_way[-1] + 1)
    return [float(np.polyfit(time[part], turned[part], 1)[0]) for part in np.array_split(whole, STRETCHES)]


def _with_source(item: Measurement, warning: str) -> str:
    """The warning with the file it speaks of; one about a view of several names that view already."""
    views = {str(quantity.detail["view"]) for quantity in item.quantities if "view" in quantity.detail}
    if any(warning.startswith(f"{view}: ") for view in views):
        return warning
    return f"{item.source.name}{' and its other views' if views else ''}: {warning}"
