"""Turn measured tilting plates into the axes and settings of the models of sliding and of rolling."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from rigtwin.lab.arrays import Array
from rigtwin.lab.errors import BadInput
from rigtwin.lab.file.lab_file import Experiment
from rigtwin.lab.quantity import Measurement
from rigtwin.lab.records import Track
from rigtwin.lab.rigs import TiltSettings

UNEVEN = math.radians(0.3)
"""[rad], largest deviation of the plate's angle from a constant rate; 0.1 m from the hinge it is 0.5 mm, the least
uncertainty with which the model of a slide knows the height of the tracked point."""
RATE, ANGLE = 0.002, 0.05  # [1], [deg]: standard uncertainties where lab.toml states none, as in a lab.json
UNKNOWN_SCALES = ("gravity", "not known")


@dataclass(frozen=True)
class Tilted:
    """One repetition until the body is stopped or lost, in the axes of a measured tilt."""

    track: Track
    angle: Array  # [rad], of the plate at each row
    source: str


def tilted(experiment: Experiment, measurement: Measurement) -> Tilted:
    """A measured repetition; raises `BadInput` if it is not the motion of the model."""
    from rigtwin.measure.tilt.evaluate import NEARBY_LENGTH_UNCERTAINTY, onset_of, way_down
    from rigtwin.measure.tilt.incline import at_rest, descent_of

    rig, source = experiment.rig, str(measurement.source)
    assert isinstance(rig, TiltSettings)
    if measurement.camera.get("scale_from") in UNKNOWN_SCALES:
        raise BadInput(
            f"{source}: the scale follows from the motion itself, which a diagnosis of the motion cannot use; state "
            "scale or known_length under [experiments.camera], or arm_length."
        )
    (plate,), (track, *_) = measurement.series, measurement.tracks
    way = way_down(plate, [track], rig.variant, experiment.particle.diameter, NEARBY_LENGTH_UNCERTAINTY)
    rests = at_rest(way)
    if rests and rig.variant == "slide":
        raise BadInput(
            f"{source}: the plate stands still; the diagnosis of a slide needs a plate that turns until the body slips."
        )
    if not rests and rig.variant == "roll":
        turn = math.degrees(float(np.ptp(way.angle)))
        raise BadInput(
            f"{source}: the plate turns by {turn:.1f} degrees; the diagnosis of a rolling bead needs a plate at rest: "
            "let the bead go on an incline, or leave this experiment out with --only."
        )
    end = descent_of(way, source).end if rests else float(way.time[onset_of(way, source)[0].end - 1])
    angle = np.interp(track.time, plate.time, plate.value, left=np.nan, right=np.nan)
    kept = (track.time <= end) & np.isfinite(angle)
    rows = replace(track, time=track.time[kept], position=track.position[kept], sigma=track.sigma[kept])
    return Tilted(rows, angle[kept], source)


def slides(runs: Sequence[Tilted], radius: float) -> tuple[list[tuple[Track, ...]], dict[str, float]]:
    """Tracks and settings of a condition of slides: one rate, one angle at time zero, one place on the arm.

    A body that lay elsewhere on the arm is moved along it, and its height above the hinge is set to that of a body on
    an arm through the hinge: at the rates of a tilt the acceleration towards the hinge, the only one that depends on
    the place, is below 1e-5 of gravity.
    """
    lines = [np.polyfit(run.track.time, run.angle, 1) for run in runs]
    for run, line in zip(runs, lines, strict=True):
        off = float(np.max(np.abs(run.angle - np.polyval(line, run.track.time))))
        if off > UNEVEN:
            raise BadInput(
                f"{run.source}: the plate's angle deviates by up to {math.degrees(off):.1f} degrees from a constant "
                "rate, which the diagnosis of a slide needs; turn the plate evenly, or leave this repetition out."
            )
    rates = np.array([line[0] for line in lines])
    rate = float(np.median(rates))
    start = min(float(np.polyval(line, run.track.time[0])) for run, line in zip(runs, lines, strict=True))
    placed = [_on_the_arm(run) for run in runs]
    rests = [np.median(one[: max(len(one) // 10, 3)], axis=0) for one in placed]
    distance = float(np.median([rest[0] for rest in rests]))
    tracks: list[tuple[Track, ...]] = []
    for run, line, place, rest in zip(runs, lines, placed, rests, strict=True):
        along, across = (place - rest + [distance, radius]).T
        angle = np.polyval(line, run.track.time)
        cos, sin = np.cos(angle), np.sin(angle)
        position = np.column_stack([along * cos - across * sin, along * sin + across * cos])
        clock = run.track.time + (float(line[1]) - start) / rate
        tracks.append((replace(run.track, time=clock, position=position),))
    settings = {
        "tilt_rate_deg_s": math.degrees(rate),
        "start_angle_deg": math.degrees(start),
        "start_distance_m": distance,
        "tilt_rate_uncertainty_rel": max(RATE, float(np.std(rates)) / abs(rate)),
    }
    return tracks, settings


def rolls(runs: Sequence[Tilted], radius: float) -> tuple[list[tuple[Track, ...]], dict[str, float]]:
    """Tracks and settings of a condition of rolls: down to the right from where the bead touches the plate at first."""
    angles = np.array([float(np.median(run.angle)) for run in runs])
    angle = float(np.median(angles))
    centre = radius * np.array([math.sin(angle), math.cos(angle)])
    tracks: list[tuple[Track, ...]] = []
    for run in runs:
        moved = run.track.position - np.median(run.track.position[:3], axis=0)
        tracks.append((replace(run.track, position=moved * [-1.0, 1.0] + centre),))
    spread = math.degrees(float(np.std(angles)))
    return tracks, {
        "incline_angle_deg": math.degrees(angle),
        "incline_angle_uncertainty_deg": max(ANGLE, spread),
    }


def _on_the_arm(run: Tilted) -> Array:
    """Place (n, 2) [m] along the arm from its axis, and across it."""
    x, y = run.track.position.T
    cos, sin = np.cos(run.angle), np.sin(run.angle)
    return np.column_stack([x * cos + y * sin, y * cos - x * sin])
