"""The twin of the pile tests: a heap of beads on a round base (Hlosta et al. 2020, fig. 5a).

How it forms is one file each: `rigtwin.sim.pile.piling`, `rigtwin.sim.pile.pouring`, `rigtwin.sim.pile.emptying`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any, Protocol, Unpack

import numpy as np
import numpy.typing as npt

from rigtwin.lab.arrays import Array
from rigtwin.lab.errors import BadInput
from rigtwin.lab.materials import Contact, Material, Particle
from rigtwin.lab.progress import Progress, silent
from rigtwin.lab.records import Profile
from rigtwin.lab.rigs import Pile
from rigtwin.sim.engine.time_step import positive
from rigtwin.sim.output.outline import VIEWS, silhouette
from rigtwin.sim.pile.emptying import Emptying, emptying, section
from rigtwin.sim.pile.piling import Course, piling
from rigtwin.sim.pile.pouring import pouring
from rigtwin.sim.run import filling
from rigtwin.sim.run.run_log import History
from rigtwin.sim.run.set_up import Bench, Numerics

# a photo of a bowl shows no more than what stands out over its rim: angles of the two are not of the same heap
COUNTED_FROM = "counted from the base plate, also where a rim hides it from the side"


@dataclass(frozen=True)
class Heap:
    """What lies on the base in the end.  x and y from the disc's axis, z above the disc's top face."""

    centres: Array  # [m], shape (n, 3), of the spheres that stay on the base
    radii: Array  # [m], shape (n,)
    radius: float  # [m], of a particle; of a clump that of the sphere that holds it
    profiles: tuple[Profile, ...]  # silhouettes from four sides; of an emptied container sections, back to back
    base_diameter: float  # [m], over which the profiles' heap stands
    at_rest: bool
    time: float  # [s], simulated
    asked: int
    placed: int
    fallen: int  # over the rim, or through the drain
    statistics: dict[str, float] = field(default_factory=dict)
    history: History | None = None  # energy, contacts and overlaps over time
    assumptions: dict[str, str] = field(default_factory=dict)  # all that the rig's description leaves open
    warnings: tuple[str, ...] = ()


def run(
    rig: Pile,
    particle: Particle,
    wall: Material,
    contact: Contact,
    wall_contact: Contact,
    *,
    count: int = 1000,
    seed: int = 1,
    pour_rate: float | None = None,
    fall_height: float | None = None,
    fill_limit: float = 3.0,
    settle_limit: float = 4.0,
    progress: Progress = silent,
    **numerics: Unpack[Numerics],
) -> Heap:
    """Let `count` beads make a heap in the way of `rig.variant` and wait until it rests.

    piling: the beads rain through a round outlet above the base's centre, without overlap, at `pour_rate` [1/s]
    (default: Beverloo's discharge of the outlet, or up to 400 per second while the throw adds no more than the fall).
    The outlet rises with the heap and stays `fall_height` [m] above its top (default: three bead diameters), unless
    `rig.outlet_height` fixes it.
    pouring, emptying: tube or container are filled and rest (at most `fill_limit` [s]) before they are let go.

    What leaves the base falls and is taken out.  The run ends when the beads rest, or `settle_limit` [s] after the last
    one was poured, the tube was clear of them, or the drain was opened, and says which.
    """
    _check(rig, particle, count, settle_limit)
    bench = Bench(rig, particle, wall, contact, wall_contact, numerics)
    method = _method(rig, particle, count, pour_rate, fall_height, fill_limit)
    method.need_bearable(bench.fastest, falls_freely=bench.falls_freely)
    bulk = bench.bulk(method.shapes, method.domain, skin=filling.SKIN)
    course = Course(random=np.random.default_rng(seed))
    asked = {"count": count, "seed": seed, "settle_limit": settle_limit}
    with bench.logbook(bulk, **asked, **method.settings) as logbook:
        if kept := logbook.resume():
            course.go_on(kept)
        if course.settling_until is None or course.let_go is None:
            method.form(bulk, logbook, course, progress)
        at_rest = filling.settle(bulk, logbook, course, particle, settle_limit, progress)
    beads, grains = bulk.beads(), bulk.grains()
    stays = (np.hypot(*grains.position[:, :2].T) < rig.base_diameter / 2 + particle.radius) & (
        grains.position[:, 2] > 0
    )
    spheres = np.isin(beads.ident if beads.grain is None else beads.grain, grains.ident[stays])
    centres, radii = beads.position[spheres], beads.radius[spheres]
    moved = () if at_rest else ("the heap was still moving when the time limit was reached; raise --settle-limit",)
    profiles = _profiles(rig, particle, method, centres, radii)
    return Heap(
        centres=centres,
        radii=radii,
        radius=particle.radius,
        profiles=profiles,
        base_diameter=float(np.ptp(profiles[0].base)) if profiles[0].base else rig.base_diameter,
        at_rest=at_rest,
        time=bulk.time,
        asked=count,
        placed=course.placed,
        fallen=course.placed - int(stays.sum()),
        statistics={**logbook.statistics(), "contacts_per_bead": 2 * bulk.contacts / max(len(grains.ident), 1)},
        history=logbook.history,
        assumptions={**method.assumptions, **bench.assumptions(), "heights_and_angles": COUNTED_FROM},
        warnings=(*bench.warnings(bulk, logbook), *method.warnings(course, grains.position[stays]), *moved),
    )


class Method(Protocol):
    """One way of making a heap."""

    @property
    def shapes(self) -> Any: ...
    @property
    def domain(self) -> Any: ...
    @property
    def settings(self) -> dict[str, Any]: ...
    @property
    def assumptions(self) -> dict[str, str]: ...
    def need_bearable(self, fastest: float, *, falls_freely: bool) -> None: ...
    def form(self, bulk: Any, logbook: Any, course: Course, progress: Progress) -> None: ...
    def warnings(self, course: Course, staying: Array) -> list[str]: ...


def _method(
    rig: Pile, particle: Particle, count: int, rate: float | None, fall_height: float | None, fill_limit: float
) -> Method:
    match rig.variant:
        case "piling":
            return piling(rig, particle, count, rate, fall_height)
        case "pouring":
            return pouring(rig, particle, count, fill_limit)
        case "emptying":
            return emptying(rig, particle, count, fill_limit)
    raise BadInput(f"pile: there is no variant {rig.variant!r}; use 'piling', 'pouring' or 'emptying'.")


def _profiles(rig: Pile, particle: Particle, method: Method, centres: Array, radii: Array) -> tuple[Profile, ...]:
    if isinstance(method, Emptying):
        grain = particle.diameter
        return tuple(section(centres, radii, rig, method.drain_diameter, grain, view) for view in VIEWS)
    return tuple(silhouette(centres, radii, rig.base_diameter, view) for view in VIEWS)


def picture(rig: Pile, heap: Heap, *, turn: float = 30.0, tilt: float = 20.0) -> npt.NDArray[np.uint8]:
    """The heap on its base as shaded spheres, an RGB image; the eye `turn` [deg] about z and `tilt` [deg] above.

    Of an emptied container the near half is cut away, so that the crater is seen.
    """
    from rigtwin.sim.output.picture import draw
    from rigtwin.sim.output.trajectory import triangles
    from rigtwin.sim.pile.piling import bowl

    reach = np.full(3, rig.base_diameter + rig.rim_height)
    walls = np.concatenate([triangles(shape, (-reach, reach)) for shape in bowl(rig)])
    shown = np.ones(len(heap.centres), dtype=bool)
    if rig.variant == "emptying":
        toward = np.array([math.sin(math.radians(turn)), -math.cos(math.radians(turn))])
        shown = heap.centres[:, :2] @ toward < 0
    return draw(heap.centres[shown], heap.radii[shown], walls=walls, turn=turn, tilt=tilt)


def check(rig: Pile, particle: Particle, *, count: int) -> None:
    """Raises `BadInput` where `run` would refuse these settings, and computes nothing."""
    _check(rig, particle, count, settle_limit=1.0)
    _method(rig, particle, count, None, None, fill_limit=1.0)


def _check(rig: Pile, particle: Particle, count: int, settle_limit: float) -> None:
    positive(base_diameter=rig.base_diameter, settle_limit=settle_limit)
    if rig.base_diameter < 4 * particle.diameter:
        raise BadInput(
            f"base_diameter: {rig.base_diameter * 1e3:.3g} mm is no base for a heap of beads of "
            f"{particle.diameter * 1e3:.3g} mm; give at least four bead diameters."
        )
    if not (math.isfinite(rig.rim_height) and rig.rim_height >= 0):
        raise BadInput(f"rim_height: {rig.rim_height:g} m is no height of a rim; give zero or more.")
    if count < 1:
        raise BadInput(f"count: {count} beads make no heap; give at least 1.")
