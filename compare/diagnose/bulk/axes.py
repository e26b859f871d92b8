"""What can differ from the statement: parameters of the twin and errors of the measurement, each over its range.

The coordinate of an axis is 0 at the stated value and reaches -1 and 1 at the ends of its range (only 0 to 1 where the
stated value is an end).  Ranges are wide enough for every value that a laboratory would take for possible.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

from rigtwin.compare.campaign.vary import Setting, at, contact_pair, of_contact
from rigtwin.compare.diagnose.bulk.bulk_lab import BulkCondition, BulkLab
from rigtwin.compare.diagnose.bulk.observables import Distortion
from rigtwin.lab.clumps import clump
from rigtwin.lab.materials import clumped, sized
from rigtwin.lab.rigs import GRAVITY, DrumSettings, HopperSettings, PackingSettings, PileSettings
from rigtwin.lab.size_distributions import uniform

COHESION = "cohesion_sjkr.energy_density"
FACTOR = 4.0  # of a coefficient or a speed, at the ends of its range
MOST_FRICTION = 1.5  # [1]
MOST_ROLLING = 0.5  # [1], where none is stated
MOST_BOND = 25.0  # [1], largest pull of cohesion over the weight of a bead
SIZE = 0.12  # relative, of the diameter
DENSITY = 0.3  # relative
DENSITY_STD = 0.01  # relative standard uncertainty; weighing and counting
SETTING_STD = 0.02  # relative standard uncertainty of speeds and heights of a rig
ROLLING_STD = 0.1  # relative standard uncertainty of a stated rolling friction where the lab states none
RESTITUTION = 0.25  # [1], change at the ends of its range
SPREAD = 0.2  # [1], relative standard deviation of the diameters
ELONGATION = 0.6  # [1], length over width less one, of a clump of two spheres
ROLL, SCALE, CLOCK = math.radians(8.0), 0.12, 0.3  # [rad], relative, relative
DELAY = 0.5  # [s]
BED_READ = 0.3  # [bead diameters], standard uncertainty of how the height of a bed is read
SURFACE_READ = 0.3  # [bead radii], standard uncertainty of how the surface in a drum is read
STARTED = 0.01  # [s], standard uncertainty of the moment of opening

Change = Callable[[Setting, float], Setting]
"""Makes the experiment and the model of a twin at a value."""


@dataclass(frozen=True)
class Axis:
    """One quantity that may differ from its statement.

    Parameters
    ----------
    name, unit, meaning : str
        Its name, SI unit, and what it is.
    value : callable
        Its value in SI at a coordinate.
    std : float
        Standard uncertainty of the stated value in the coordinate; 0 where a difference is an effect.
    levels : tuple of float
        Coordinates at which twins are run; empty for an axis that needs none.
    setting : callable, optional
        The experiment and the model of a condition's twin at a value.
    distortion : callable, optional
        The error of the measurement at a value.
    mass : callable, optional
        Factor on the mass of all particles at a value, for an axis without twins.
    rigs : tuple of str
        Rigs on which it acts.
    symmetric : bool
        Whether the coordinate may be negative.
    """

    name: str
    unit: str
    meaning: str
    value: Callable[[float], float]
    std: float = 0.0
    levels: tuple[float, ...] = ()
    setting: Change | None = None
    distortion: Callable[[float], Distortion] | None = None
    mass: Callable[[float], float] | None = None
    rigs: tuple[str, ...] = ("pile", "packing", "drum", "hopper")
    symmetric: bool = True

    @property
    def low(self) -> float:
        return -1.0 if self.symmetric else 0.0


def axes_of(lab: BulkLab) -> tuple[Axis, ...]:
    """The axes of a lab, of which each acts in one of its rigs at least."""
    there = {one.rig for one in lab.conditions}
    every = (*_contact_axes(lab), *_particle_axes(lab), *_rig_axes(lab), *_camera_axes(lab), _spread())
    return tuple(axis for axis in every if there & set(axis.rigs))


def acts(axis: Axis, condition: BulkCondition) -> bool:
    return condition.rig in axis.rigs


def twin_setting(lab: BulkLab, condition: BulkCondition, point: Mapping[Axis, float]) -> Setting:
    """The experiment and the model of a condition's twin at coordinates of axes."""
    found = Setting(condition.experiment, lab.model)
    for axis, coordinate in point.items():
        if axis.setting is not None and acts(axis, condition):
            found = axis.setting(found, axis.value(coordinate))
    return found


def _stated(setting: Setting, parameter: str) -> float:
    """A coefficient of a contact, as the experiment states it; 0 where it states none."""
    contact = setting.model.known_contact(*contact_pair(parameter, setting.experiment))
    return getattr(contact, of_contact(parameter)) or 0.0


def _coefficients(of_first: Mapping[str, float], *, stated: float) -> Change:
    """A setting with other coefficients of contacts: `of_first` if their common value is `stated`.

    An experiment that states others has its own changed by the same factor.
    """

    def moved(setting: Setting, value: float) -> Setting:
        factor = value / stated if stated > 0 else math.inf
        own = {name: _stated(setting, name) for name in of_first}
        scaled = {name: own[name] * factor for name in own if own[name] > 0 and stated > 0}
        return at(setting, {name: scaled.get(name, value * share) for name, share in of_first.items()})

    return moved


def _about(stated: float, most: float = math.inf, factor: float = FACTOR) -> Callable[[float], float]:
    """A scale of factors about a stated value, up to `most`."""

    def value(coordinate: float) -> float:
        high = min(factor, most / stated) if coordinate > 0 else factor
        return float(stated * high**coordinate)

    return value


def _up_to(most: float, stated: float = 0.0) -> Callable[[float], float]:
    """Upwards from a stated value near zero; small values take a larger part of the coordinate."""
    return lambda coordinate: stated + (most - stated) * coordinate * abs(coordinate)


def _friction(name: str, meaning: str, stated: float, std: float, moved: Change, rigs: Sequence[str] = ()) -> Axis:
    """The axis of a coefficient of friction."""
    everywhere = tuple(rigs) or ("pile", "packing", "drum", "hopper")
    levels: tuple[float, ...]
    if stated < 2 * std or stated <= 0:
        value, symmetric, levels = _up_to(1.0, stated), False, (0.4, 0.7, 1.0)
        spread = math.sqrt(std)
    else:
        value, symmetric, levels = _about(stated, MOST_FRICTION), True, (-1.0, -0.5, 0.5, 1.0)
        spread = std / stated / math.log(FACTOR)
    return Axis(name, "1", meaning, value, spread, levels, moved, rigs=everywhere, symmetric=symmetric)


def _contact_axes(lab: BulkLab) -> Iterator[Axis]:
    wall, like = lab.contacts(lab.conditions[0])
    known = lab.uncertain
    yield _rolling(lab, wall.rolling_friction or like.rolling_friction / lab.arm)
    for name, meaning, stated in (
        ("static_friction", "between particles", like.static_friction),
        ("wall_static_friction", "of particles and wall", wall.static_friction),
    ):
        yield _friction(name, meaning, stated, known.friction, _coefficients({name: 1.0}, stated=stated))
    drums = [one.experiment.rig for one in lab.conditions if isinstance(one.experiment.rig, DrumSettings)]
    if drums:
        stated = wall.static_friction if drums[0].end_wall_friction is None else drums[0].end_wall_friction
        name = "end_wall_friction"
        yield _friction(name, "of particles and end walls", stated, known.friction, _end_walls, ("drum",))

    def livelier(setting: Setting, change: float) -> Setting:
        own = {name: _stated(setting, name) for name in ("restitution", "wall_restitution")}
        return at(setting, {name: min(max(one + change, 0.05), 0.98) for name, one in own.items()})

    yield Axis(
        "restitution", "1", "of all contacts, over the stated ones", lambda u: RESTITUTION * u,
        known.restitution / RESTITUTION, (-1.0, 1.0), livelier,
    )  # fmt: skip
    yield _cohesion(lab)


def _end_walls(setting: Setting, value: float) -> Setting:
    return at(setting, {"end_wall_friction": value})


def _rolling(lab: BulkLab, stated: float) -> Axis:
    """One coefficient of rolling friction for all contacts, in the lab's convention."""
    std = lab.uncertain.rolling
    moved = _coefficients({"rolling_friction": lab.arm, "wall_rolling_friction": 1.0}, stated=stated)
    meaning = "coefficient of rolling friction, in the lab's convention"
    if stated <= 0:
        return Axis(
            "rolling_friction", "1", meaning, _up_to(MOST_ROLLING), math.sqrt(std / MOST_ROLLING),
            (0.25, 0.5, 0.75, 1.0), moved, symmetric=False,
        )  # fmt: skip
    spread = (std or ROLLING_STD * stated) / stated / math.log(FACTOR)
    return Axis(
        "rolling_friction", "1", meaning, _about(stated, 4 * MOST_ROLLING), spread, (-1.0, -0.5, 0.5, 1.0), moved
    )


def energy_density(lab: BulkLab, condition: BulkCondition, bond: float) -> float:
    """Energy density k [J/m^3] of a cohesion whose largest pull is `bond` weights of a bead.

    The pull 2 pi k R* d less Hertz's force 4/3 E* sqrt(R*) d^(3/2) is largest, (4/27) (2 pi k R*)^3 over the square of
    4/3 E* sqrt(R*), at 4/9 of the overlap d at which both are equal.
    """
    bead = condition.experiment.particle
    solid = bead.material
    modulus = solid.youngs_modulus * lab.stiffness_factor(condition) / (2 * (1 - solid.poisson_ratio**2))
    radius = bead.radius / 2
    hertz = 4 / 3 * modulus * math.sqrt(radius)
    pull = (27 / 4 * bond * bead.mass * GRAVITY * hertz**2) ** (1 / 3)
    return float(pull / (2 * math.pi * radius))


def _cohesion(lab: BulkLab) -> Axis:
    strongest = min(energy_density(lab, one, MOST_BOND) for one in lab.conditions)
    return Axis(
        COHESION, "J/m^3", "pull of a contact over its area, of particles and walls",
        lambda u: strongest * abs(u) ** (2 / 3), 0.0, (0.15, 0.4, 0.7, 1.0),
        lambda setting, value: at(setting, {COHESION: value}), symmetric=False,
    )  # fmt: skip


def _particle_axes(lab: BulkLab) -> Iterator[Axis]:
    known = lab.uncertain

    def sized(setting: Setting, value: float) -> Setting:
        return at(setting, {"diameter": setting.experiment.particle.typical.diameter * (1 + value)})

    yield Axis(
        "diameter", "1", "diameter over the stated one, less 1", lambda u: SIZE * u, known.diameter_rel / SIZE,
        (-1.0, -0.5, 0.5, 1.0), sized,
    )  # fmt: skip
    yield Axis(
        "density", "1", "density over the stated one, less 1", lambda u: DENSITY * u, DENSITY_STD / DENSITY,
        mass=lambda value: 1 + value,
    )  # fmt: skip
    yield Axis(
        "elongation", "1", "length over width of the particles, less 1", lambda u: ELONGATION * u, 0.0,
        (0.5, 1.0), elongated, symmetric=False,
    )  # fmt: skip


def elongated(setting: Setting, value: float) -> Setting:
    """The particle as a clump of two spheres with its volume and mass, longer than wide by `value`."""
    bead = setting.experiment.particle
    if value <= 0 or bead.shape is not None or bead.sizes is not None:
        return setting
    unit = clump([(-value / 2, 0.0, 0.0), (value / 2, 0.0, 0.0)], 0.5)
    width = (bead.volume / unit.volume) ** (1 / 3)
    shape = clump([(-value / 2 * width, 0.0, 0.0), (value / 2 * width, 0.0, 0.0)], width / 2)
    longer = clumped(bead.name, bead.material, shape, mass=bead.mass)
    return Setting(replace(setting.experiment, particle=longer), setting.model)


def _spread() -> Axis:
    return Axis(
        "size_spread", "1", "relative standard deviation of the diameters", lambda u: SPREAD * u, 0.0, (0.5, 1.0),
        spread, symmetric=False,
    )  # fmt: skip


def spread(setting: Setting, value: float) -> Setting:
    """The spheres with diameters of this relative standard deviation about the stated one, uniformly distributed."""
    bead = setting.experiment.particle
    if value <= 0 or bead.shape is not None or bead.sizes is not None:
        return setting
    half = math.sqrt(3) * value
    mixed = sized(bead, uniform(bead.diameter * (1 - half), bead.diameter * (1 + half)))
    return Setting(replace(setting.experiment, particle=mixed), setting.model)


def _rig_axes(lab: BulkLab) -> Iterator[Axis]:
    rigs = [one.experiment.rig for one in lab.conditions]
    piles = [one for one in rigs if isinstance(one, PileSettings)]
    if any(one.lift_speed is not None for one in piles):
        yield _changed("lift_speed", "speed of the tube over the stated one", "pile")
    heights = [one for one in rigs if isinstance(one, PackingSettings) and one.fall_height is not None]
    if heights:
        yield _changed("fall_height", "height of fall over the stated one", "packing")
    if any(one.outlet_height is not None for one in piles):
        yield _changed("outlet_height", "height of the outlet over the stated one", "pile", factor=2.0)
    if any(isinstance(one, DrumSettings) for one in rigs):
        yield _changed("speed", "speed of the drum over the stated one", "drum")


def _changed(name: str, meaning: str, rig: str, factor: float = FACTOR) -> Axis:
    """A setting of a rig by a factor."""

    def moved(setting: Setting, value: float) -> Setting:
        stated = getattr(setting.experiment.rig, name, None)
        return setting if stated is None else at(setting, {name: stated * value})

    return Axis(
        name, "1", meaning, _about(1.0, factor=factor), SETTING_STD / math.log(factor), (-1.0, 1.0), moved, rigs=(rig,)
    )


def _camera_axes(lab: BulkLab) -> Iterator[Axis]:
    known = lab.uncertain
    outlines = ("pile", "packing", "drum")
    yield Axis(
        "camera_roll", "rad", "angle by which the camera is turned", lambda u: ROLL * u, known.roll / ROLL,
        distortion=lambda value: Distortion(roll=value), rigs=outlines,
    )  # fmt: skip
    yield Axis(
        "scale", "1", "relative error of all lengths", lambda u: SCALE * u, known.scale_rel / SCALE,
        distortion=lambda value: Distortion(scale=value), rigs=outlines,
    )  # fmt: skip
    if any(isinstance(one.experiment.rig, HopperSettings) for one in lab.conditions):
        yield Axis(
            "frame_rate", "1", "relative error of all times", lambda u: CLOCK * u, known.clock_rel / CLOCK,
            distortion=lambda value: Distortion(clock=value), rigs=("hopper",),
        )  # fmt: skip
        yield Axis(
            "opening_delay", "s", "time by which the outlet opens late", lambda u: DELAY * u, STARTED / DELAY,
            distortion=lambda value: Distortion(delay=value), rigs=("hopper",),
        )  # fmt: skip
    yield Axis(
        "surface_reading", "1", "part of a bead's radius by which the surface is read too low", lambda u: 2 * u, 0.02,
        distortion=lambda value: Distortion(lowered=value), rigs=("pile",),
    )  # fmt: skip
    yield Axis(
        "drum_surface_reading", "1", "part of a bead's radius by which the surface is read too low", lambda u: 2 * u,
        SURFACE_READ / 2, distortion=lambda value: Distortion(lowered=value), rigs=("drum", "packing"),
    )  # fmt: skip
    yield Axis(
        "bed_reading", "1", "bead diameters by which the height of a bed is read too high", lambda u: u, BED_READ,
        distortion=lambda value: Distortion(bed=value), rigs=("pile", "packing"),
    )  # fmt: skip
