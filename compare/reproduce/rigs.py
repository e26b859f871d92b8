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
from rigtwin.lab.rigs import Pile

RIM = 10e-3  # [m]
PILED = 1.6  # beads poured over those that a heap of 30 degrees and a full bowl would hold

ASSUMED = {
    "rim": "the bowls have a rim of 10 mm, and what stands above it is read, as a camera beside the bowl sees it (the "
    "paper gives neither; without a rim no pile stands)",
    "piled": "1.6 times as many particles are poured as bowl and heap hold; the surplus falls over the rim",
}


def piling(particle: str, *, base_diameter: float, seed: int, wall: str = "steel", rim: float = RIM) -> dict[str, Any]:
    """Angles of repose [deg] of one pile, means over four views and both sides (tables 14 and 15)."""
    import numpy as np

    from rigtwin.compare.twin import pile_twin
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


def piled_count(base_diameter: float, rim: float, volume: float) -> int:
    """How many particles of `volume` [m^3] to pour on a bowl.

    >>> piled_count(90e-3, 10e-3, 124.8e-9)
    885
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
