"""The paper's rigs as runs: each function runs one twin and returns plain numbers.

All parameters are the paper's calibrated ones (tables A2 to A7, stiffness reduced to a thousandth); what the paper
leaves unsaid is an argument with the inferred value as its default, and `ASSUMED` says where it comes from.  The
rolling law is "type C" where a run does not say it: so were those made that were kept before there was a choice.
"""

from __future__ import annotations

import inspect
import math
import re
from collections.abc import Mapping
from dataclasses import asdict, replace
from typing import TYPE_CHECKING, Any

from rigtwin.compare.deviation import over_views
from rigtwin.lab.quantity import Evaluation
from rigtwin.lab.reference import hlosta2020
from rigtwin.lab.rigs import Drum, Hopper, Packing, Pile

if TYPE_CHECKING:
    from rigtwin.compare.twins.many_body import Cast
    from rigtwin.lab.materials import Particle
    from rigtwin.sim.engine.contact import Rolling

RIM = 10e-3  # [m]
CYLINDER = 65e-3  # [m]
HIGHER = 1.5  # times as high is the cylinder into which a bed is poured again that the first did not hold
DRUM = 140e-3  # [m]
DEPTH = 30e-3  # [m]
FILL = 0.35
PACKED = 0.6  # part of a bed's volume that is beads, about
TURNS = 0.75  # of the drum
SLOT = 68e-3  # [m]
OUTLET = 50e-3  # [m], of the conical hopper
PRINTED_EMPTIED = 12223  # particles, table 13 at 1e6 Pa
PILED = 1.6  # beads poured over those that a heap of 30 degrees and a full bowl would hold

ASSUMED = {
    "rim": "the bowls have a rim of 10 mm, and what stands above it is read, as a camera beside the bowl sees it (the "
    "paper gives neither; without a rim no pile stands)",
    "cylinder": "the 1000 mL cylinder of PMMA is 65 mm wide inside (from the paper's masses and bed heights); a "
    "bed that spills over its edge is poured again into one half as high again",
    "tops": "a bed's height is that of the tops of its surface's beads, where a gauge is read, as it is for a "
    "bed in a photo; the mean surface, pits included, lies some half a bead lower",
    "d12": "390 D12 beads, not 800, stand in the cylinder (800 do not fit under the printed height)",
    "before": "the paper's own column of table 7 was simulated before the calibration (section 3.1); the rows so "
    "called have the frictions among particles that it took then, 0.2 and 0.01 (beads) or 0.5 and 0.1 (cubes and "
    "pellets; static and rolling), and wooden beads and the cube of 24 spheres before they were enlarged; contacts "
    "with the wall and all restitutions are the calibrated ones, for those of then are not told",
    "computing": "ours is the processor time of one thread from the first particle poured until the bed is read, "
    "kernels that are compiled then included, over the number of particles; the paper tells neither its computer nor "
    "what it counts, so that its seconds only stand beside ours",
    "swept": "tables 4 to 6 print how far the simulated bed is from the measured one without its sign; particles are "
    "those of tables A2 to A7 (the enlarged beads), but for their friction among each other",
    "drum": "the PMMA drum is 30 mm deep and 35 % full, and its end walls turn with it (the paper gives none of these; "
    "in its experiment and its simulation beads of 12 mm lie 10 to 22 degrees steeper than those of 6 mm with like "
    "frictions, which only near end walls do to ours: 16 degrees, graphical, where they are 30 mm apart, 10 at 50 mm)",
    "wall": "bowls are of steel; drum, cylinder and hoppers of PMMA",
    "slot": "the hopper of section 2.2.5 is a slot 68 mm long, whose width is the printed outlet (a round outlet of "
    "that size would pass a tenth of the printed flow)",
    "conical": "particles that left the conical hopper of section 2.2.3 within 5 s, over 5 s, as the printed number of "
    "emptied particles is to be read; where all left before, these are as many at any flow and are not set against the "
    "paper's; the steady flow stands beside what the paper prints and is another thing",
    "piled": "1.6 times as many particles are poured as bowl and heap hold; the surplus falls over the rim",
    "pour": "particles fall from one particle's size above the heap, with which the outlet rises, as many a second as "
    "Beverloo's law has for an outlet a quarter of the base wide, at least three particles (the paper gives neither, "
    "and says that a heap falls apart under particles from too great a height)",
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

    Read above the rim and, with the suffix ``_from_plate``, above the base plate.  `count` beads are poured (None: the
    surplus falls over the rim) through an outlet at `outlet_height` [m] above the base.  None: it rises with the heap,
    `fall_height` [m] above it, and passes what Beverloo's law says; without that either, the twin pours from its usual
    height, and quicker.
    """
    import numpy as np

    from rigtwin.compare.twins.pile import pile_twin
    from rigtwin.measure.pile import evaluate as pile

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
    above = [replace(profile, height=np.maximum(profile.height - rim, 0.0)) for profile in twin.profiles]
    seen = pile.evaluate(above, base_diameter=base_diameter, bead_diameter=bead.diameter)
    from_plate = {f"{name}_from_plate": angle for name, angle in _angles(twin.evaluation).items()}
    highest = max(float(profile.height.max()) for profile in twin.profiles)
    return {**_angles(seen), **from_plate, "height_mm": 1e3 * highest, **_course(twin)}


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
    """Height [mm] of the bed that `count` particles make in the cylinder (tables 4 to 7).

    Where particles fall over the cylinder's edge the bed is poured once more, into a cylinder half as high again.
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
    """Dynamic angles of repose [deg] in the drum that turns at `speed` [rad/s] (tables 14 and 15)."""
    from rigtwin.compare.twins.drum import drum_twin

    rig = Drum(diameter, speed, depth, fill)
    twin = drum_twin(rig, _cast(particle, "PMMA"), seed=seed, turns=turns, threads=1, rolling=rolling)
    return {**_angles(twin.evaluation), "mixing_index": twin.settings["mixing_index"], **_course(twin)}


def slot_hopper(
    particle: str,
    *,
    outlet: float,
    count: int,
    seed: int,
    slot_length: float = SLOT,
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
    """Emptied D6 beads and mass flow [g/s] of the conical hopper at a shear modulus [Pa] (table 13)."""
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
    """What a run's settings stand for: the rig's inferred sizes, and particle, wall and contacts as they are now.

    Of a clump what does not hang on how it is turned.  How the engine works is not among it: that is the version's.  A
    new argument of a rig makes all its runs other ones.
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
    """How many particles of `volume` [m^3] to pour on a bowl.

    >>> piled_count(90e-3, 10e-3, 124.8e-9)
    882
    """
    radius = base_diameter / 2
    space = 3.14159 * radius**2 * (rim + radius * 0.577 / 3)
    return round(surplus * 0.58 * space / volume)


def pour_rate(particle: Particle, base_diameter: float) -> float:
    """[1/s], by Beverloo's law, through the outlet that a twin has over a base of that diameter [m]."""
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
    """Particle, wall and contacts as the paper calibrated them, with other frictions among the particles if given.

    Not `enlarged`: wooden beads and the cube of 24 spheres are as large as before the calibration.
    """
    from rigtwin.compare.twins.many_body import Cast

    contact = hlosta2020.contact(particle, particle)
    other = {"static_friction": static_friction, "rolling_friction": rolling_friction}
    contact = replace(contact, **{name: value for name, value in other.items() if value is not None})
    bead = hlosta2020.particle(particle, enlarged=enlarged)
    return Cast(bead, hlosta2020.material(wall), contact, hlosta2020.contact(particle, wall))


def _angles(evaluation: Evaluation) -> dict[str, float]:
    """Mean over all views and both sides, of the first method and of the others under their own names."""
    found: dict[str, float] = {}
    for quantity in over_views(evaluation.quantities):
        if quantity.unit != "deg" or quantity.detail.get("side") not in (None, "mean"):
            continue
        method = quantity.quantity.removeprefix("angle_of_repose_")
        found.setdefault(f"{method}_deg", quantity.value)
        found[f"{method}_{re.sub('[^a-z0-9]+', '_', quantity.method).strip('_')}_deg"] = quantity.value
    return found


def _course(twin: Any) -> dict[str, Any]:
    """What a reader of the table wants to know of the run itself."""
    settings = twin.settings
    kept = {name: settings[name] for name in ("asked", "placed", "fallen", "at_rest") if name in settings}
    return {**kept, "wall_s": twin.seconds, "warnings": list(twin.warnings)}
