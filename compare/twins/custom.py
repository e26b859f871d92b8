"""Twin of a rig of the user's own; there is no measurement of it, so it is none of the rigs of `compare`."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Unpack

from rigtwin.compare.twins import by_name
from rigtwin.compare.twins.many_body import Cast, Computed, bulk_twin
from rigtwin.compare.twins.twin import Twin
from rigtwin.lab.errors import reworded_refusals
from rigtwin.lab.progress import Progress, silent
from rigtwin.lab.quantity import Evaluation, Quantity

if TYPE_CHECKING:
    from rigtwin.lab.custom_rig import CustomRig
    from rigtwin.lab.file.own_rigs import OwnRig
    from rigtwin.lab.materials import Contact, Material
    from rigtwin.sim.custom import CustomRun
    from rigtwin.sim.run.set_up import Numerics

NAME = "custom"


def cast_of_own(own: OwnRig) -> tuple[Cast, dict[str, tuple[Material, Contact]]]:
    """Return particle, wall and contacts of a rig of the user's own.

    Parameters
    ----------
    own : OwnRig
        Rig of which particle, wall and contacts are taken.

    Returns
    -------
    cast : Cast
        Particle, the rig's wall, and their contacts.
    surfaces : dict of str to tuple
        Material and contact of walls that are of another material, by name.

    Raises
    ------
    BadInput
        If a contact is not known.
    """
    bead, model = own.particle, own.model

    def at(material: str) -> tuple[Material, Contact]:
        return by_name.wall(material, model), by_name.contact(bead.name, material, model, options=False)

    wall, wall_contact = at(own.wall)
    others = {name: at(one.material) for name, one in own.rig.walls.items() if one.material != own.wall}
    return Cast(bead, wall, by_name.contact(bead.name, bead.name, model, options=False), wall_contact), others


def custom_twin(
    rig: CustomRig,
    cast: Cast,
    *,
    count: int,
    seed: int,
    surfaces: Mapping[str, tuple[Material, Contact]] | None = None,
    notes: Sequence[str] = (),
    located: Callable[[str], str] = str,
    progress: Progress = silent,
    **numerics: Unpack[Numerics],
) -> Twin:
    """Simulate a rig of the user's own.

    Parameters
    ----------
    rig : CustomRig
        Walls, filling, duration and regions.
    cast : Cast
        Particle, wall and contacts.
    count : int
        Number of particles.
    seed : int
        Seed of the random numbers.
    surfaces : mapping, optional
        Material and contact of walls that are of another material than `cast.wall`, by name.
    notes : sequence of str
        Remarks on the rig, which go among the warnings.
    located : callable
        Puts file and line before a refusal, where the rig is one of a file (`OwnRig.located`).
    progress : Progress
        Called with step, number and count.
    **numerics
        Numerical settings of the run.

    Returns
    -------
    Twin
        Particles in the regions, bed heights [m] and discharged mass [kg], with their course over time.

    Raises
    ------
    BadInput
        If the settings are not possible.
    """
    from rigtwin.sim import custom

    begun = time.perf_counter()
    with reworded_refusals(located):
        course = custom.run(rig, *cast, count=count, seed=seed, surfaces=surfaces, progress=progress, **numerics)
    twin = custom_result(rig, cast, course, Computed(begun, seed, numerics.get("threads")), surfaces=surfaces)
    return replace(twin, warnings=(*notes, *twin.warnings))


def custom_result(
    rig: CustomRig,
    cast: Cast,
    course: CustomRun,
    computed: Computed,
    *,
    surfaces: Mapping[str, tuple[Material, Contact]] | None = None,
) -> Twin:
    """Return the twin of a run that was simulated.

    Parameters
    ----------
    rig, cast : CustomRig, Cast
        As for `custom_twin`.
    course : CustomRun
        What happened in the run.
    computed : Computed
        How it was computed.
    surfaces : mapping, optional
        As for `custom_twin`.

    Returns
    -------
    Twin
        As `custom_twin` returns it.
    """
    from rigtwin.sim import custom

    found = []
    for region, (particles, mass) in course.inside.items():
        about: dict[str, str | int | float | bool] = {"region": region}
        found.append(Quantity("particles_inside", particles, 0.0, "1", "count at the end", detail=about))
        found.append(Quantity("mass_inside", mass, 0.0, "kg", "sum at the end", detail=about))
        if particles and rig.regions:
            height = course.bed_heights[region]
            # one run does not show the scatter from run to run
            bed = Quantity("bed_height", height, math.nan, "m", "mean of the uppermost particles", detail=about)
            moves = "" if course.at_rest else "the particles were still moving at the end"
            found.append(replace(bed, doubtful=moves))
    particles, mass = course.discharged
    found.append(Quantity("particles_discharged", particles, 0.0, "1", "through the lower side of the domain"))
    found.append(Quantity("mass_discharged", mass, 0.0, "kg", "through the lower side of the domain"))
    if course.mass_flow_rate is not None:
        found.append(Quantity("mass_flow_rate", course.mass_flow_rate, math.nan, "kg/s", "line, 20-80 % of the mass"))
    numbers = {
        "asked": course.asked,
        "placed": course.placed,
        "escaped": course.escaped[0],
        "resting": course.at_rest,
        "time_s": course.time,
        "walls": {name: material.name for name, (material, _) in (surfaces or {}).items()},
    }
    twin = bulk_twin(
        NAME, rig, cast, course, Evaluation(tuple(found)), computed, numbers, series=course.series,
        draw=lambda: custom.picture(rig, course),
    )  # fmt: skip
    return replace(twin, loads=course.loads)
