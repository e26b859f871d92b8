"""Records of laboratory and twin as the same numbers: curves on one grid, and single results.

An outline or surface is a height over the place across the rig, a discharge the time over the share that has left.
Both enter by mean, tilt and principal components of what remains.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from rigtwin.compare.campaign.run import Result
from rigtwin.compare.campaign.twin_runs import quantities_of, twin_from
from rigtwin.compare.diagnose.bulk.bulk_lab import BulkCondition, Record
from rigtwin.compare.twins.registry import entry_of
from rigtwin.lab.arrays import Array
from rigtwin.lab.records import Profile
from rigtwin.lab.rigs import DrumSettings, HopperSettings, PackingSettings, PileSettings
from rigtwin.lab.size_distributions import Sizes

POINTS = 61  # of the grid of a curve
ACROSS = {"pile": 0.97, "packing": 0.85, "drum": 0.65}
"""Share of the half width of a rig over which its outline is compared; further out it is that of single beads."""
# [bead diameters], by which a bed is usually read above its mean surface; the mean of the highest points in cells
# as wide as a bead lies 0.4 above it, the outline from a side 0.9
ABOVE_SURFACE = 0.3
REACH = 0.5  # share of its grid that a curve covers at least; a steep bed does not reach across a drum
LEFT = (0.03, 0.92)  # shares that have left, between which the times of a discharge are compared
COMPONENTS = 3  # of a curve, beside mean and tilt
LEAST = 0.02  # share of the variance among the curves that a component has at least
NUMBERS = ("bed_height", "bed_height_by_outline", "total_mass", "on_base", "stuck")
UNITS = {"bed_height": "m", "bed_height_by_outline": "m", "total_mass": "kg", "on_base": "1", "stuck": "1"}
FROM_THE_RIM = 1e-4  # [m], above the rim, from where on a heap is seen


@dataclass(frozen=True)
class Seen:
    """What one look at a rig shows: a curve on the grid of its condition, and single numbers; NaN where unknown."""

    curve: Array | None  # shape (POINTS,), [m] or [s]
    numbers: Mapping[str, float]


@dataclass(frozen=True)
class Distortion:
    """An error of the measurement that acts on the record of a rig.

    Parameters
    ----------
    roll : float
        Angle [rad] by which the camera is turned.
    scale : float
        Relative error of lengths.
    clock : float
        Relative error of times.
    delay : float
        Time [s] by which the clock starts before the outlet opens.
    lowered : float
        Part of a bead's radius by which a surface is read too low, 1: through the centres.
    bed : float
        Bead diameters by which the height of a bed is read higher than usual.
    """

    roll: float = 0.0
    scale: float = 0.0
    clock: float = 0.0
    delay: float = 0.0
    lowered: float = 0.0
    bed: float = 0.0


NONE = Distortion()


def half_width(condition: BulkCondition) -> float:
    """[m], half of the base, cylinder or drum; 1 for a hopper, whose grid is a share."""
    rig = condition.experiment.rig
    if isinstance(rig, PileSettings):
        return rig.base_diameter / 2
    if isinstance(rig, PackingSettings):
        return rig.cylinder_diameter / 2
    return rig.drum_diameter / 2 if isinstance(rig, DrumSettings) else 1.0


def grid(condition: BulkCondition) -> Array:
    """The places [m], or shares that have left [1], at which a curve is read."""
    if isinstance(condition.experiment.rig, HopperSettings):
        return np.linspace(*LEFT, POINTS)
    reach = ACROSS[condition.rig] * half_width(condition)
    return np.linspace(-reach, reach, POINTS)


def of_record(condition: BulkCondition, record: Record, mirrored: bool) -> Seen:
    """A repetition of the laboratory; `mirrored` where its drum turns the other way than the twin's."""
    curve = None
    if record.x is not None and record.y is not None:
        x, y = (-record.x[::-1], record.y[::-1]) if mirrored else (record.x, record.y)
        curve = _read(condition, x, y, NONE)
    return Seen(curve, {name: record.numbers.get(name, math.nan) for name in NUMBERS})


def of_twin(condition: BulkCondition, result: Result, distortion: Distortion = NONE) -> list[Seen]:
    """The views of a twin, as the measurement with its error would show them."""
    twin = twin_from(result)
    numbers = _numbers(condition, twin.settings, result, distortion)
    if isinstance(condition.experiment.rig, HopperSettings):
        curves = [_read(condition, *_discharged(one.time, one.value), distortion) for one in twin.series[:1]]
    else:
        curves = [_read(condition, *_across(one), distortion) for one in twin.profiles]
    return [Seen(curve, numbers) for curve in curves] or [Seen(None, numbers)]


def turns_the_other_way(condition: BulkCondition) -> bool:
    """Whether the surfaces of a drum rise to the right; the twin's fall to the right."""
    if condition.rig != "drum":
        return False
    slopes = [np.polyfit(one.x, one.y, 1)[0] for one in condition.records if one.x is not None and one.y is not None]
    return bool(slopes) and float(np.mean(slopes)) > 0


def _across(profile: Profile) -> tuple[Array, Array]:
    known = np.isfinite(profile.height)
    return profile.x[known], profile.height[known]


def _discharged(time: Array, left: Array) -> tuple[Array, Array]:
    return time, left[0] - left


def _numbers(
    condition: BulkCondition, settings: Mapping[str, Any], result: Result, distortion: Distortion
) -> dict[str, float]:
    """Single results of a twin; the mass is that of all its particles."""
    experiment = condition.experiment
    found = dict.fromkeys(NUMBERS, math.nan)
    surface = settings.get("bed_height_m", settings.get("surface_height_m"))
    if surface is not None:
        above = (ABOVE_SURFACE + distortion.bed) * experiment.particle.typical.diameter
        found["bed_height"] = surface * (1 + distortion.scale) + above
    heights = [one.value for one in quantities_of(result) if one.quantity == "bed_height" and not one.doubtful]
    if heights:  # read as a film is, by the same function
        found["bed_height_by_outline"] = heights[0] * (1 + distortion.scale)
    if "fallen" in settings:
        found["on_base"] = float(settings["placed"] - settings["fallen"])
    if experiment.rig_name == "hopper":
        found["stuck"] = float(settings["remaining"])
    count = entry_of(experiment).count(experiment, None)  # type: ignore[attr-defined]
    if count is not None:
        bead = settings["particle"]
        found["total_mass"] = count * bead["density"] * _volume(bead)
    return found


def _volume(bead: Mapping[str, Any]) -> float:
    """Mean volume [m^3] of the particles."""
    shape, sizes = bead.get("shape"), bead.get("sizes")
    largest = float(shape["volume"]) if shape else math.pi / 6 * bead["diameter"] ** 3
    if not sizes:
        return largest
    found = Sizes(tuple(sizes["diameters"]), tuple(sizes["shares"]))
    return largest * found.mean_power(3) / found.largest**3


def _read(condition: BulkCondition, x: Array, y: Array, distortion: Distortion) -> Array | None:
    """A curve on the grid of its condition, its ends held; None where it does not reach over half of it."""
    at = grid(condition)
    if condition.rig == "hopper":
        return _times(x, y, at, distortion)
    experiment = condition.experiment
    turned = math.tan(distortion.roll)
    size = 1 + distortion.scale
    lowered = y - distortion.lowered * experiment.particle.typical.radius
    across, up = size * (x + turned * lowered), size * (lowered - turned * x)
    order = np.argsort(across, kind="stable")
    inside = (at >= across.min()) & (at <= across.max())
    if inside.mean() < REACH:
        return None
    found = np.interp(at, across[order], up[order])
    if isinstance(experiment.rig, PileSettings):  # a rim hides what lies behind it
        found = np.maximum(found, experiment.rig.rim_height + FROM_THE_RIM)
    return found


def _times(time: Array, mass: Array, shares: Array, distortion: Distortion) -> Array | None:
    """Times [s] at which shares of what leaves have left."""
    gone = np.maximum.accumulate(np.abs(mass - mass[0]))
    if gone[-1] <= 0:
        return None
    rises = np.concatenate([[True], np.diff(gone) > 0])
    found = np.interp(shares, gone[rises] / gone[-1], time[rises])
    return np.asarray((found + distortion.delay) * (1 + distortion.clock))


@dataclass(frozen=True)
class Features:
    """The numbers by which records of one condition are compared."""

    condition: BulkCondition
    names: tuple[str, ...]
    units: tuple[str, ...]
    sizes: Array
    """Of each number, what a relative uncertainty refers to, in its unit."""
    vectors: Array
    """Of the curve, shape (c, POINTS): mean, tilt, components; the product with a curve gives the first numbers."""
    middle: Array  # shape (POINTS,)

    def of(self, seen: Seen) -> Array:
        """The numbers of one look; NaN where it does not have them."""
        curve = np.full(len(self.vectors), math.nan)
        if seen.curve is not None and len(self.vectors):
            curve = self.vectors @ (seen.curve - self.middle)
        return np.concatenate([curve, [seen.numbers[name] for name in self.names[len(self.vectors) :]]])


def features_of(condition: BulkCondition, measured: Sequence[Seen], twins: Sequence[Seen]) -> Features:
    """Which numbers both sides have; components (`sklearn.decomposition.PCA`) are those of the twins' curves."""
    curves = np.array([one.curve for one in twins if one.curve is not None])
    names: list[str] = []
    units: list[str] = []
    sizes: list[float] = []
    vectors, middle = np.empty((0, POINTS)), np.zeros(POINTS)
    if len(curves) and any(one.curve is not None for one in measured):
        vectors, middle = _basis(curves), curves.mean(axis=0)
        size = float(np.mean(np.abs(middle))) if condition.rig != "drum" else half_width(condition) / 3
        what, unit = ("time", "s") if condition.rig == "hopper" else ("outline", "m")
        names += [f"mean {what}", f"slope of the {what}"]
        names += [f"component {k + 1} of the {what}" for k in range(len(vectors) - 2)]
        units += [unit] * len(vectors)
        sizes += [size] * len(vectors)
    for name in NUMBERS:
        ours = np.array([one.numbers[name] for one in twins])
        if np.isfinite(ours).any() and any(math.isfinite(one.numbers[name]) for one in measured):
            names.append(name)
            units.append(UNITS[name])
            sizes.append(float(np.nanmean(np.abs(ours))))
    return Features(condition, tuple(names), tuple(units), np.array(sizes), vectors, middle)


def _basis(curves: Array) -> Array:
    """Mean and tilt, and principal components of what these leave; root mean squares along the curve."""
    from sklearn.decomposition import PCA

    along = np.linspace(-1, 1, POINTS)
    first = np.array([np.ones(POINTS), along / math.sqrt(np.mean(along**2))])
    rest = curves - (curves @ first.T / POINTS) @ first
    number = min(COMPONENTS, len(rest) - 1)
    if number < 1 or not np.ptp(rest, axis=0).any():
        return first / POINTS
    found = PCA(number).fit(rest)
    kept = found.components_[found.explained_variance_ratio_ > LEAST]
    return np.vstack([first, kept * math.sqrt(POINTS)]) / POINTS
