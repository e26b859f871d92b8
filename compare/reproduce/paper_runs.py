"""The rigs of the paper as runs: each function runs one twin and returns plain numbers.

All parameters are the paper's calibrated ones (tables A2 to A7, stiffness reduced to a thousandth).  What the paper
does not state is an argument with an inferred default, whose origin is in `ASSUMED`.  The default rolling law is
"type C", because runs kept before there was a choice used it.
"""

from __future__ import annotations

import inspect
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from typing import TYPE_CHECKING, Any

from rigtwin.compare.deviation import over_views
from rigtwin.lab.errors import BadInput
from rigtwin.lab.reference import hlosta2020
from rigtwin.lab.rig_quantities import ABOVE_RIM
from rigtwin.lab.rigs import SLOT_LENGTH, Drum, Hopper, Packing, Pile

if TYPE_CHECKING:
    from rigtwin.compare.twins.many_body import Cast
    from rigtwin.lab.materials import Particle
    from rigtwin.lab.quantity import Quantity
    from rigtwin.sim.engine.contact import Rolling

RIM = 10e-3  # [m], height of the rim of a bowl
CYLINDER = 65e-3  # [m], inner diameter of the cylinder
HIGHER = 1.5  # factor on the height of the cylinder if the bed spilled over
DRUM = 140e-3  # [m], inner diameter of the drum
DEPTH = 30e-3  # [m], depth of the drum
FILL = 0.35  # filled share of the drum's volume
PACKED = 0.6  # approximate packing fraction of a bed
TURNS = 0.75  # revolutions of the drum
OUTLET = 50e-3  # [m], outlet diameter of the conical hopper
PRINTED_EMPTIED = 12223  # emptied particles, table 13 at 1e6 Pa
PILED = 1.6  # particles poured over the number in a full bowl with a pile of 30 degrees

ASSUMED = {
    "rim": "the bowls have a rim of 10 mm, and the pile is read above it, as a camera beside the bowl sees it (the "
    "paper states neither; without a rim no pile forms)",
    "cylinder": "the 1000 mL cylinder of PMMA is 65 mm wide inside (from the paper's masses and bed heights); a "
    "bed that spills over its edge is poured again into one half as high again",
    "tops": "a bed's height is that of the tops of its surface beads, where a gauge is read, as for a bed in a photo; "
    "the mean surface, pits included, is about half a bead lower",
    "d12": "390 D12 beads, not 800, stand in the cylinder (800 do not fit under the printed height)",
    "before": "the paper's own column of table 7 was simulated before the calibration (section 3.1); the rows so "
    "called have the frictions among particles that it used then, 0.2 and 0.01 (beads) or 0.5 and 0.1 (cubes and "
    "pellets; static and rolling), and wooden beads and the cube of 24 spheres before they were enlarged; contacts "
    "with the wall and all restitutions are the calibrated ones, because the paper does not state the earlier ones",
    "computing": "ours is the processor time of one thread from the first particle poured until the bed is read, "
    "including the compilation of kernels, over the number of particles; the paper states neither its computer nor "
    "what its time includes, so that the two are not compared",
    "swept": "tables 4 to 6 print the absolute deviation of the simulated bed from the measured one; particles are "
    "those of tables A2 to A7 (the enlarged beads), except for the friction between particles",
    "drum": "the PMMA drum is 30 mm deep and 35 % full, and its end walls turn with it (the paper states none of "
    "these; in its experiment and its simulation beads of 12 mm are 10 to 22 degrees steeper than those of 6 mm with "
    "similar frictions, which our twin shows only with close end walls: 16 degrees, graphical, at a distance of 30 mm, "
    "10 at 50 mm)",
    "wall": "bowls are of steel; drum, cylinder and hoppers of PMMA",
    "slot": "the hopper of section 2.2.5 is a slot 68 mm long, whose width is the printed outlet (a round outlet of "
    "that size would pass a tenth of the printed flow)",
    "conical": "particles that left the conical hopper of section 2.2.3 within 5 s, over 5 s, as the printed number of "
    "emptied particles is understood; if all left earlier, this number does not depend on the flow and is not compared "
    "with the paper's; the steady flow is listed beside the paper's value but is a different quantity",
    "piled": "1.6 times as many particles are poured as bowl and pile hold; the surplus falls over the rim",
    "pour": "particles fall from one particle diameter above the pile, the outlet rises with it, and their rate "
    "follows Beverloo's law for an outlet a quarter of the base wide, at least three particles (the paper states "
    "neither, and says that a pile falls apart under particles from too great a height)",
}
ROLLED: Mapping[Rolling, str] = {
    "type A": "rolling friction is a constant torque mu_r F_n R against a particle's own spin, R from the contact to "
    "its centre of mass (type A): the standard rolling friction of EDEM, the paper's code, as its manual has it; the "
    "paper names none",
    "type A explicit": "rolling friction is a constant torque mu_r F_n R against a particle's own spin, R from the "
    "contact to its centre of mass, which takes at most the spin at the beginning of a time step (type A explicit): "
    "EDEM's manual does not say how a spin ends; of four ways that were tried this one came nearest to the paper's "
    "beds of high rolling friction, and what rests creeps",
    "type C": "rolling friction is a spring and a dashpot up to the torque mu_r F_n R (type C), which is not the "
    "standard one of EDEM, the paper's code: --rolling-model A takes that",
}


def piling(
    particle: str,
    *,
    base_diameter: float,
    seed: int,
    wall: str = "steel",
    rim: float = RIM,
    count: int | None = None,
    outlet_height: float | None = None,
    fall_height: float | None = None,
    surplus: float = PILED,
    rolling: Rolling = "type C",
) -> dict[str, Any]:
    """Angles of repose [deg] of one pile, means over four views and both sides (tables 14 and 15).

    Read above the rim and, with the suffix ``_from_plate``, above the base plate.  `count` is the number of beads
    (None: a surplus that falls over the rim), `outlet_height` [m] the height of the outlet above the base.  With None
    the outlet rises with the pile, `fall_height` [m] above it, at the rate of Beverloo's law; with `fall_height` None,
    too, the twin pours from its usual height and faster.
    """
    from rigtwin.compare.twins.pile import pile_twin

    cast = _cast(particle, wall)
    bead = cast.particle
    twin = pile_twin(
        Pile(base_diameter, rim, outlet_height=outlet_height),
        cast,
        pour_rate=None if fall_height is None else pour_rate(bead, base_diameter),
        fall_height=fall_height,
        count=count or piled_count(base_diameter, rim, bead.mass / bead.effective_density, surplus),
        seed=seed,
        threads=1,
        rolling=rolling,
    )
    every = twin.evaluation.quantities
    plate = [one for one in every if not one.method.endswith(ABOVE_RIM)]
    above = [replace(one, method=one.method.removesuffix(ABOVE_RIM)) for one in every if one.method.endswith(ABOVE_RIM)]
    if rim > 0 and not above:
        raise BadInput(f"{particle}: nothing of the heap stands above the rim of {1e3 * rim:g} mm.")
    from_plate = {f"{name}_from_plate": angle for name, angle in _angles(plate).items()}
    highest = max(float(profile.height.max()) for profile in twin.profiles)
    return {**_angles(above or plate), **from_plate, "height_mm": 1e3 * highest, **_course(twin)}


def packing(
    particle: str,
    *,
    count: int,
    seed: int,
    cylinder: float = CYLINDER,
    static_friction: float | None = None,
    rolling_friction: float | None = None,
    enlarged: bool = True,
    higher: float = HIGHER,
    rolling: Rolling = "type C",
) -> dict[str, Any]:
    """Height [mm] of the bed of `count` particles in the cylinder (tables 4 to 7).

    If particles fall over the edge, the bed is poured once more into a cylinder `higher` times as high.
    """
    from rigtwin.compare.twins.packing import cylinder_for, packing_twin

    cast = _cast(particle, "PMMA", static_friction, rolling_friction, enlarged=enlarged)
    rig = cylinder_for(Packing(cylinder), cast.particle, count)
    twin = packing_twin(rig, cast, count=count, seed=seed, threads=1, rolling=rolling)
    if twin.settings["missed"]:
        rig = replace(rig, cylinder_height=higher * rig.cylinder_height)
        twin = packing_twin(rig, cast, count=count, seed=seed, threads=1, rolling=rolling)
    heights = {item.method: item.value for item in twin.evaluation.quantities if item.quantity == "bed_height"}
    kept = ("packing_fraction", "seconds_per_particle", "missed")
    return {
        "surface_height_mm": 1e3 * twin.settings["surface_height_m"],
        "bead_tops_height_mm": 1e3 * heights["surface bead tops"],
        "outline_height_mm": 1e3 * heights["outline"],
        "cylinder_height_mm": 1e3 * rig.cylinder_height,
        **{name: twin.settings[name] for name in kept},
        **_course(twin),
    }


def drum(
    particle: str,
    *,
    speed: float,
    seed: int,
    turns: float = TURNS,
    diameter: float = DRUM,
    depth: float = DEPTH,
    fill: float = FILL,
    rolling: Rolling = "type C",
) -> dict[str, Any]:
    """Dynamic angles of repose [deg] in the drum at `speed` [rad/s] (tables 14 and 15)."""
    from rigtwin.compare.twins.drum import drum_twin

    rig = Drum(diameter, speed, depth, fill)
    twin = drum_twin(rig, _cast(particle, "PMMA"), seed=seed, turns=turns, threads=1, rolling=rolling)
    return {**_angles(twin.evaluation.quantities), "mixing_index": twin.settings["mixing_index"], **_course(twin)}


def slot_hopper(
    particle: str,
    *,
    outlet: float,
    count: int,
    seed: int,
    slot_length: float = SLOT_LENGTH,
    wall: str = "PMMA",
    rolling: Rolling = "type C",
) -> dict[str, Any]:
    """Discharge time [s] of the slot hopper (table 16)."""
    from rigtwin.compare.twins.hopper import hopper_twin

    rig = Hopper(outlet, "slot", slot_length=slot_length)
    twin = hopper_twin(rig, _cast(particle, wall), count=count, seed=seed, threads=1, rolling=rolling)
    last = twin.settings["last_bead_s"]
    return {**({} if last is None else {"discharge_time_s": last}), **_course(twin)}


def conical_hopper(
    *,
    shear_modulus: float,
    outlet: float = OUTLET,
    count: int = 15000,
    seed: int = 1,
    seconds: float = 5.0,
    rolling: Rolling = "type C",
) -> dict[str, Any]:
    """Number of emptied D6 beads and mass flow [g/s] of the conical hopper at a shear modulus [Pa] (table 13)."""
    import numpy as np

    from rigtwin.compare.twins.hopper import hopper_twin

    cast = _cast("D6", "PMMA")
    bead = cast.particle
    factor = shear_modulus / bead.material.shear_modulus
    twin = hopper_twin(
        Hopper(outlet),
        cast,
        count=count,
        seed=seed,
        duration=seconds,
        stiffness_factor=factor,
        threads=1,
        rolling=rolling,
    )
    emptied, steady = twin.settings["emptied"], twin.settings["mass_flow_rate_kg_s"]
    (left,) = twin.series
    gone = np.asarray(left.value[0] - left.value) / bead.mass
    reached = np.flatnonzero(gone >= PRINTED_EMPTIED)
    return {
        "emptied": emptied,
        "mass_flow_g_s": 1e3 * emptied * bead.mass / seconds,
        "steady_mass_flow_g_s": None if steady is None else 1e3 * steady,
        "printed_count_left_after_s": float(left.time[reached[0]]) if len(reached) else None,
        "rayleigh_step_s": replace(bead, material=bead.material.softened(factor)).rayleigh_time_step,
        **_course(twin),
    }


def inputs(function: str, settings: Mapping[str, Any]) -> dict[str, Any]:
    """The data behind a run's settings: the rig's inferred sizes, and particle, wall and contacts as they are now.

    Of a clump only properties that do not depend on its orientation.  The engine is not included: the version covers
    it.  A new argument of a rig function invalidates all its kept runs.
    """
    taken = inspect.signature(globals()[function]).parameters.values()
    rig = {one.name: one.default for one in taken if one.default is not inspect.Parameter.empty} | dict(settings)
    cast = _cast(
        rig.get("particle", "D6"),
        rig.get("wall", "PMMA"),
        rig.get("static_friction"),
        rig.get("rolling_friction"),
        enlarged=rig.get("enlarged", True),
    )
    bead = cast.particle
    layout = {} if bead.shape is None else {
        "gyration": sorted(bead.shape.gyration),
        "spheres": sorted((math.hypot(*at), radius) for at, radius in zip(bead.shape.offsets, bead.radii, strict=True)),
    }  # fmt: skip
    return {
        "rig": {name: value for name, value in rig.items() if name not in settings},
        "particle": {"diameter": bead.diameter, "mass": bead.mass, "material": asdict(bead.material), **layout},
        "wall": asdict(cast.wall),
        "contact": asdict(cast.contact),
        "wall_contact": asdict(cast.wall_contact),
    }


def piled_count(base_diameter: float, rim: float, volume: float, surplus: float = PILED) -> int:
    """Number of particles of `volume` [m^3] to pour on a bowl.

    >>> piled_count(90e-3, 10e-3, 124.8e-9)
    882
    """
    radius = base_diameter / 2
    space = 3.14159 * radius**2 * (rim + radius * 0.577 / 3)
    return round(surplus * 0.58 * space / volume)


def pour_rate(particle: Particle, base_diameter: float) -> float:
    """Pouring rate [1/s] by Beverloo's law, through the outlet of a twin over a base of that diameter [m]."""
    from rigtwin.sim.pile.piling import outlet_diameter
    from rigtwin.sim.run.filling import beverloo

    return beverloo(particle, outlet_diameter(base_diameter, particle.diameter), particle.diameter)


def _cast(
    particle: str,
    wall: str,
    static_friction: float | None = None,
    rolling_friction: float | None = None,
    *,
    enlarged: bool = True,
) -> Cast:
    """Calibrated particle, wall and contacts of the paper, with other frictions between the particles if given.

    Not `enlarged`: wooden beads and the cube of 24 spheres have their size before the calibration.
    """
    from rigtwin.compare.twins.many_body import Cast

    contact = hlosta2020.contact(particle, particle)
    other = {"static_friction": static_friction, "rolling_friction": rolling_friction}
    contact = replace(contact, **{name: value for name, value in other.items() if value is not None})
    bead = hlosta2020.particle(particle, enlarged=enlarged)
    return Cast(bead, hlosta2020.material(wall), contact, hlosta2020.contact(particle, wall))


def _angles(quantities: Sequence[Quantity]) -> dict[str, float]:
    """Mean angles over all views and both sides, by method; the first method also without its name."""
    found: dict[str, float] = {}
    for quantity in over_views(quantities):
        if quantity.unit != "deg" or quantity.detail.get("side") not in (None, "mean"):
            continue
        method = quantity.quantity.removeprefix("angle_of_repose_")
        found.setdefault(f"{method}_deg", quantity.value)
        found[f"{method}_{re.sub('[^a-z0-9]+', '_', quantity.method).strip('_')}_deg"] = quantity.value
    return found


def _course(twin: Any) -> dict[str, Any]:
    """Particle numbers, rest state, wall-clock time [s] and warnings of the run."""
    settings = twin.settings
    kept = {name: settings[name] for name in ("asked", "placed", "fallen", "at_rest") if name in settings}
    return {**kept, "wall_s": twin.seconds, "warnings": list(twin.warnings)}
