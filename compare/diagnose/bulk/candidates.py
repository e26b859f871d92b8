"""The effects that are tried in labs with many particles: the axis that each frees, and what separates it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

from rigtwin.compare.diagnose.bulk.axes import COHESION, Axis
from rigtwin.compare.diagnose.bulk.bulk_lab import BulkLab


@dataclass(frozen=True)
class BulkEffect:
    """An effect by name.

    Parameters
    ----------
    name, title : str
        Its name in results and in prose; that of the effect's file where there is one.
    kind : {"physical", "measurement"}
        Whether it changes the bed or only its record.
    axis : str
        Name of the axis that it frees.
    parameter : str
        Name of the coefficient in results.
    equation : str
        What it does, in a formula or a few words.
    splits : str
        The experiment that separates it from others.
    source : str
        Where its law is described.
    """

    name: str
    title: str
    kind: Literal["physical", "measurement"]
    axis: str
    parameter: str
    equation: str
    splits: str
    source: str = "Hlosta et al. 2020"


EFFECTS = (
    BulkEffect(
        "rolling_resistance", "rolling resistance", "physical", "rolling_friction", "rolling_friction",
        "torque of at most mu_r F_n times the lever", "a single bead that rolls down an incline, and a drum",
    ),
    BulkEffect(
        "sliding_friction", "sliding friction between particles", "physical", "static_friction", "static_friction",
        "tangential force of at most mu F_n", "a tilting plate covered with the particles, and beads of two sizes",
    ),
    BulkEffect(
        "wall_friction", "wall friction", "physical", "wall_static_friction", "static_friction",
        "tangential force of at most mu F_n at walls", "a tilting plate of the wall's material, and another wall",
    ),
    BulkEffect(
        "end_wall_friction", "end-wall friction", "physical", "end_wall_friction", "static_friction",
        "tangential force of at most mu F_n at the end walls", "a drum of another length, over which end walls matter",
    ),
    BulkEffect(
        "cohesion_sjkr", "cohesion", "physical", COHESION, "energy_density", "F = k A, A = 2 pi R* d",
        "beads of two sizes: cohesion matters as 1/d^2; a loose bed in a narrow cylinder",
        "the linear form used in bulk simulation after Johnson, Kendall & Roberts 1971",
    ),
    BulkEffect(
        "non_spherical_shape", "non-spherical shape", "physical", "elongation", "elongation",
        "clump of two spheres with the same volume", "a photograph of single particles, and a packing, which is denser",
    ),
    BulkEffect(
        "particle_size", "particle size", "physical", "diameter", "diameter_change", "d = (1 + s) stated d",
        "weigh and count particles, and measure some",
    ),
    BulkEffect(
        "size_distribution", "size distribution", "physical", "size_spread", "relative_std",
        "diameters scatter about their mean", "sieve the particles, or measure fifty of them",
    ),
    BulkEffect(
        "particle_density", "particle density", "physical", "density", "density_change", "rho = (1 + s) stated rho",
        "weigh and count particles, and measure some",
    ),
    BulkEffect(
        "lift_speed", "lift speed", "physical", "lift_speed", "factor", "v = f stated v",
        "film the lift, or lift at half the speed",
    ),
    BulkEffect(
        "pour_height", "pour height", "physical", "fall_height", "factor", "h = f stated h",
        "measure the outlet's height, or pour from twice as high",
    ),
    BulkEffect(
        "outlet_height", "height of the outlet", "physical", "outlet_height", "factor", "h = f stated h",
        "measure the outlet's height, or pour from twice as high",
    ),
    BulkEffect(
        "drum_speed", "speed of the drum", "physical", "speed", "factor", "omega = f stated omega",
        "count turns with a stop watch",
    ),
    BulkEffect(
        "opening_delay", "opening delay", "measurement", "opening_delay", "delay", "t' = t + delay",
        "film the slide as it opens",
    ),
    BulkEffect(
        "camera_roll", "camera roll", "measurement", "camera_roll", "angle", "height' = height - x tan(phi)",
        "film a plumb line",
    ),
    BulkEffect(
        "scale_error", "scale error", "measurement", "scale", "relative", "x' = (1 + s) x",
        "film a ruler in the plane of the heap",
    ),
    BulkEffect(
        "frame_rate_error", "wrong frame rate", "measurement", "frame_rate", "relative", "t' = (1 + s) t",
        "film a running clock",
    ),
    BulkEffect(
        "reading_convention", "reading convention of the outline", "measurement", "surface_reading", "lowered",
        "height' = height - s d / 2", "read the same photo by the beads' edges and by their centres",
    ),
)  # fmt: skip

LEAST_SIGNIFICANCE = 3.0  # standard uncertainties


def effects_of(lab: BulkLab, axes: Sequence[Axis]) -> Iterator[BulkEffect]:
    """The effects that can act in a lab."""
    there = {axis.name for axis in axes}
    return (one for one in EFFECTS if one.axis in there)
