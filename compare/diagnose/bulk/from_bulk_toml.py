"""Turn the piles, packings, drums and hoppers of a lab.toml into a lab for the diagnosis; media are measured first."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from rigtwin.compare.chosen import chosen
from rigtwin.compare.diagnose.bulk.bulk_lab import BulkCondition, BulkLab, Record, Uncertain
from rigtwin.compare.diagnose.data.from_lab_toml import not_diagnosed
from rigtwin.compare.measure_repetitions import Measured, measuring
from rigtwin.compare.result_files import others_before
from rigtwin.compare.twins.registry import entry_of
from rigtwin.lab.errors import BadInput
from rigtwin.lab.file.lab_file import Experiment, Lab, read_lab
from rigtwin.lab.progress import Progress, silent
from rigtwin.lab.quantity import Measurement, Quantity


def bulk_lab_of(
    path: Path,
    only: Sequence[str],
    out: Path,
    progress: Progress = silent,
    *,
    allow_outside: bool = False,
    workers: int | None = None,
) -> BulkLab | None:
    """The experiments with many particles of a lab.toml; None where those asked for, or the first, are of other rigs.

    Raises `BadInput` for a name that the lab does not have, and where single bodies and many particles are asked for
    together.
    """
    lab = read_lab(path, allow_outside=allow_outside)
    asked = chosen(lab, only)
    bulk = [one for one in asked if entry_of(one).many_particles]
    if not bulk or (not only and not entry_of(asked[0]).many_particles):
        return None
    if only and len(bulk) < len(asked):
        other = next(one.id for one in asked if one not in bulk)
        raise BadInput(
            f"{lab.path}: {bulk[0].id} holds many particles and {other} a single body; diagnose them one after the "
            "other, with --only ID."
        )
    others_before(out, "diagnosis.json", lab.folder, [one.id for one in bulk])
    with measuring(bulk, out, workers) as pending:
        measured = pending.results(progress)
    return _lab(lab, bulk, measured, [] if only else not_diagnosed(lab, bulk))


def _lab(lab: Lab, bulk: Sequence[Experiment], measured: Mapping[str, Measured], not_asked: Sequence[str]) -> BulkLab:
    conditions, left_out = [], list(not_asked)
    for one in bulk:
        found = measured[one.id]
        left_out += [f"{one.id}: {failure.source.name} was left out: {failure.message}" for failure in found.failures]
        records = [_record(one, item) for item in found.measurements]
        records += [_stated(one)] if one.measured and not records else []
        if records:
            conditions.append(BulkCondition(one, tuple(records)))
        else:
            left_out.append(f"{one.id}: nothing was measured there")
    if not conditions:
        raise BadInput(f"{lab.path}: nothing was measured in {', '.join(one.id for one in bulk)}.")
    stated = lab.uncertainty
    uncertain = Uncertain(
        scale_rel=stated.get("scale", Uncertain.scale_rel),
        roll=stated.get("camera_roll", Uncertain.roll),
        clock_rel=stated.get("frame_rate", Uncertain.clock_rel),
    )
    return BulkLab(lab.title, lab.folder, tuple(conditions), lab.model, uncertain, 1.0, tuple(left_out))


def _record(experiment: Experiment, measurement: Measurement) -> Record:
    """Curve and results of a repetition; the views of one heap are one curve."""
    numbers = _numbers(measurement.quantities)
    if experiment.rig_name == "hopper":
        series = next((one for one in measurement.series if one.unit == "kg"), None)
        if series is None:
            return Record(None, None, numbers)
        known = np.isfinite(series.value)
        time = series.time[known] - _opened(measurement)
        return Record(time, series.value[known][0] - series.value[known], numbers)
    outlines = [one for one in measurement.profiles if np.isfinite(one.height).sum() > 1]
    if not outlines:
        return Record(None, None, numbers)
    middles = [sum(one.base) / 2 if one.base is not None else float(np.mean(one.x[[0, -1]])) for one in outlines]
    low = max(float(one.x[np.isfinite(one.height)][0]) - mid for one, mid in zip(outlines, middles, strict=True))
    high = min(float(one.x[np.isfinite(one.height)][-1]) - mid for one, mid in zip(outlines, middles, strict=True))
    x = np.linspace(low, high, 400)
    heights = [
        np.interp(x, one.x[np.isfinite(one.height)] - mid, one.height[np.isfinite(one.height)])
        for one, mid in zip(outlines, middles, strict=True)
    ]
    return Record(x, np.mean(heights, axis=0), numbers)


def _stated(experiment: Experiment) -> Record:
    return Record(None, None, _numbers(experiment.measured))


def _numbers(quantities: Sequence[Quantity]) -> dict[str, float]:
    heights = [
        one.value
        for one in quantities
        if one.quantity == "bed_height" and math.isfinite(one.value) and not one.doubtful
    ]
    return {"bed_height_by_outline": heights[0]} if heights else {}


def _opened(measurement: Measurement) -> float:
    """[s], moment of opening on the clock of the film."""
    found = [one.value for one in measurement.quantities if one.quantity == "opening_time"]
    return found[0] if found and math.isfinite(found[0]) else 0.0
