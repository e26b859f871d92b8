"""Twin of the pile on a round base."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Unpack

from rigtwin.compare.twins.many_body import Cast, bulk_twin
from rigtwin.compare.twins.twin import Twin, stated
from rigtwin.lab.progress import Progress, silent
from rigtwin.lab.rigs import Pile

if TYPE_CHECKING:
    from rigtwin.sim.run.set_up import Numerics


def pile_twin(
    rig: Pile,
    cast: Cast,
    *,
    count: int,
    seed: int,
    pour_rate: float | None = None,
    fall_height: float | None = None,
    fill_limit: float | None = None,
    settle_limit: float | None = None,
    progress: Progress = silent,
    **numerics: Unpack[Numerics],
) -> Twin:
    """Simulate a pile of particles on a round base and evaluate its profiles, seen from the sides.

    Parameters
    ----------
    rig : Pile
        Base diameter [m], rim [m] and way of forming the pile.
    cast : Cast
        Particle, wall and contacts.
    count : int
        Number of particles.
    seed : int
        Seed of the random numbers.
    pour_rate : float, optional
        Particles per second [1/s], as in `rigtwin.sim.pile.pile.run`.
    fall_height : float, optional
        Height of fall [m], as in `rigtwin.sim.pile.pile.run`.
    fill_limit, settle_limit : float, optional
        Longest times of filling and settling [s], as in `rigtwin.sim.pile.pile.run`.
    progress : Progress
        Called with step, number and count.
    **numerics
        Numerical settings of the run.

    Returns
    -------
    Twin
        Angles of repose [deg] and profiles.

    Raises
    ------
    BadInput
        If the settings are not possible, or the profiles cannot be evaluated.
    """
    from rigtwin.sim.pile import pile

    begun = time.perf_counter()
    heap = pile.run(
        rig,
        *cast,
        count=count,
        seed=seed,
        pour_rate=pour_rate,
        fall_height=fall_height,
        progress=progress,
        **stated(fill_limit=fill_limit, settle_limit=settle_limit),
        **numerics,
    )
    from rigtwin.measure.pile import evaluate as ruler

    evaluation = ruler.evaluate(heap.profiles, base_diameter=heap.base_diameter, bead_diameter=cast.particle.diameter)
    course = {"asked": heap.asked, "placed": heap.placed, "fallen": heap.fallen, "at_rest": heap.at_rest}
    shown = heap.profiles, (), lambda: pile.picture(rig, heap)
    return bulk_twin("pile", rig, cast, heap, evaluation, begun, seed, numerics, course, *shown)
