"""The paper's rigs as runs: each function runs one twin and returns plain numbers.

All parameters are the paper's calibrated ones (tables A2 to A7, stiffness reduced to a thousandth); what the paper
leaves unsaid is an argument with the inferred value as its default, and `ASSUMED` says where it comes from.
"""

from __future__ import annotations

from dataclasses import replace
from statistics import fmean
from typing import Any

from rigtwin.compare.deviation import over_views
from rigtwin.lab.quantity import Evaluation
from rigtwin.lab.reference import hlosta2020
from rigtwin.lab.rigs import Drum, Hopper, Pile

RIM = 10e-3  # [m]
CYLINDER = 65e-3  # [m]
DRUM = 140e-3  # [m]
DEPTH = 50e-3  # [m]
FILL = 0.35
SLOT = 68e-3  # [m]
PILED = 1.6  # beads poured over those that a heap of 30 degrees and a full bowl would hold

ASSUMED = {
    "rim": "the bowls have a rim of 10 mm, and what stands above it is read, as a camera beside the bowl sees it (the "
    "paper gives neither; without a rim no pile stands)",
    "cylinder": "the 1000 mL cylinder of PMMA is 65 mm wide inside (from the paper's masses and bed heights)",
    "d12": "390 D12 beads, not 800, stand in the cylinder (800 do not fit under the printed height)",
    "drum": "the PMMA drum is 50 mm deep and 35 % full, and its end walls turn with it (the paper gives none of these)",
    "wall": "bowls are of steel; drum, cylinder and hoppers of PMMA",
    "slot": "the hopper of section 2.2.5 is a slot 68 mm long, whose width is the printed outlet (a round outlet of "
    "that size would pass a tenth of the printed flow)",
    "conical": "particles that left the conical hopper of section 2.2.3 within 5 s, over 5 s, as the printed number of "
    "emptied particles is to be read; the steady flow stands beside it",
    "piled": "1.6 times as many particles are poured as bowl and heap hold; the surplus falls over the rim",
}


def piling(particle: str, *, base_diameter: float, seed: int, wall: str = "steel", rim: float = RIM) -> dict[str, Any]:
    """Angles of repose [deg] of one pile, means over four views and both sides (tables 14 and 15)."""
    import numpy as np

    from rigtwin.compare.bulk_twins import pile_twin
    from rigtwin.measure import pile

    bead = hlosta2020.particle(particle)
    rig = Pile(base_diameter, rim)
    twin = pile_twin(
        rig,
        bead,
        hlosta2020.material(wall),
        hlosta2020.contact(particle, particle),
        hlosta2020.contact(particle, wall),
        count=piled_count(base_diameter, rim, bead.mass / bead.effective_density),
        seed=seed,
        threads=1,
    )
    above = [replace(profile, height=np.maximum(profile.height - rim, 0.0)) for profile in twin.profiles]
    seen = pile.evaluate(above, base_diameter=base_diameter, bead_diameter=bead.diameter)
    from_plate = {f"{name}_from_plate": angle for name, angle in _angles(twin.evaluation).items()}
    return {**_angles(seen), **from_plate, **_course(twin)}


def packing(
    particle: str,
    *,
    count: int,
    seed: int,
    cylinder: float = CYLINDER,
    static_friction: float | None = None,
    rolling_friction: float | None = None,
) -> dict[str, Any]:
    """Height [m] of the bed that `count` particles make in the cylinder (tables 4 to 7)."""
    from rigtwin.compare.bulk_twins import cylinder_for, packing_twin

    bead = hlosta2020.particle(particle)
    contact = hlosta2020.contact(particle, particle)
    if static_friction is not None:
        contact = replace(contact, static_friction=static_friction)
    if rolling_friction is not None:
        contact = replace(contact, rolling_friction=rolling_friction)
    twin = packing_twin(
        cylinder_for(cylinder, bead, count),
        bead,
        hlosta2020.material("PMMA"),
        contact,
        hlosta2020.contact(particle, "PMMA"),
        count=count,
        seed=seed,
        threads=1,
    )
    height = next(item.value for item in twin.evaluation.quantities if item.quantity == "bed_height")
    kept = ("surface_height_m", "packing_fraction", "seconds_per_particle", "missed")
    return {"bed_height_mm": 1e3 * height, **{name: twin.settings[name] for name in kept}, **_course(twin)}


def drum(particle: str, *, speed: float, seed: int, turns: float = 0.75) -> dict[str, Any]:
    """Dynamic angles of repose [deg] in the drum that turns at `speed` [rad/s] (tables 14 and 15)."""
    from rigtwin.compare.bulk_twins import drum_twin

    twin = drum_twin(
        Drum(DRUM, speed, DEPTH, FILL),
        hlosta2020.particle(particle),
        hlosta2020.material("PMMA"),
        hlosta2020.contact(particle, particle),
        hlosta2020.contact(particle, "PMMA"),
        seed=seed,
        turns=turns,
        threads=1,
    )
    return {**_angles(twin.evaluation), "mixing_index": twin.settings["mixing_index"], **_course(twin)}


def slot_hopper(particle: str, *, outlet: float, count: int, seed: int) -> dict[str, Any]:
    """Discharge time [s] of the slot hopper (table 16)."""
    from rigtwin.compare.bulk_twins import hopper_twin

    twin = hopper_twin(
        Hopper(outlet, "slot", slot_length=SLOT),
        hlosta2020.particle(particle),
        hlosta2020.material("PMMA"),
        hlosta2020.contact(particle, particle),
        hlosta2020.contact(particle, "PMMA"),
        count=count,
        seed=seed,
        threads=1,
    )
    last = twin.settings["last_bead_s"]
    return {**({} if last is None else {"discharge_time_s": last}), **_course(twin)}


def conical_hopper(*, shear_modulus: float, count: int = 15000, seed: int = 1, seconds: float = 5.0) -> dict[str, Any]:
    """Emptied D6 beads and mass flow [g/s] of the conical hopper at a shear modulus [Pa] (table 13)."""
    from rigtwin.compare.bulk_twins import hopper_twin

    bead = hlosta2020.particle("D6")
    factor = shear_modulus / bead.material.shear_modulus
    twin = hopper_twin(
        Hopper(50e-3),
        bead,
        hlosta2020.material("PMMA"),
        hlosta2020.contact("D6", "D6"),
        hlosta2020.contact("D6", "PMMA"),
        count=count,
        seed=seed,
        duration=seconds,
        stiffness_factor=factor,
        threads=1,
    )
    emptied = twin.settings["emptied"]
    steady = twin.settings["mass_flow_rate_kg_s"]
    return {
        "emptied": emptied,
        "mass_flow_g_s": 1e3 * emptied * bead.mass / seconds,
        "steady_mass_flow_g_s": None if steady is None else 1e3 * steady,
        "rayleigh_step_s": replace(bead, material=bead.material.softened(factor)).rayleigh_time_step,
        **_course(twin),
    }


def piled_count(base_diameter: float, rim: float, volume: float) -> int:
    """How many particles of `volume` [m^3] to pour on a bowl.

    >>> piled_count(90e-3, 10e-3, 124.8e-9)
    882
    """
    radius = base_diameter / 2
    space = 3.14159 * radius**2 * (rim + radius * 0.577 / 3)
    return round(PILED * 0.58 * space / volume)


def _angles(evaluation: Evaluation) -> dict[str, float]:
    """Mean over all views and sides."""
    found = {}
    for method in ("graphical", "geometric"):
        mine = [
            quantity.value
            for quantity in over_views(evaluation.quantities)
            if quantity.quantity == f"angle_of_repose_{method}" and quantity.detail.get("side") in (None, "mean")
        ]
        if mine:
            found[f"{method}_deg"] = fmean(mine)
    return found


def _course(twin: Any) -> dict[str, Any]:
    """What a reader of the table wants to know of the run itself."""
    settings = twin.settings
    kept = {name: settings[name] for name in ("asked", "placed", "fallen", "at_rest") if name in settings}
    return {**kept, "wall_s": twin.seconds, "warnings": list(twin.warnings)}
