"""Simulation of the pile tests: a heap of beads on a round base (Hlosta et al. 2020, fig. 5a).

One file per method: `rigtwin.sim.pile.piling`, `rigtwin.sim.pile.pouring`, `rigtwin.sim.pile.emptying`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Protocol, Unpack

import numpy as np
import numpy.typing as npt

from rigtwin.lab.arrays import Array
from rigtwin.lab.errors import BadInput
from rigtwin.lab.materials import Contact, Material, Particle
from rigtwin.lab.progress import Progress, silent
from rigtwin.lab.records import Profile
from rigtwin.lab.rigs import Pile
from rigtwin.lab.units import positive
from rigtwin.sim.output.outline import VIEWS, silhouette
from rigtwin.sim.pile.emptying import Emptying, emptying, section
from rigtwin.sim.pile.piling import Course, piling
from rigtwin.sim.pile.pouring import Pouring, pouring
from rigtwin.sim.run import filling
from rigtwin.sim.run.run_log import History
from rigtwin.sim.run.set_up import Bench, Numerics

if TYPE_CHECKING:
    from rigtwin.sim.engine.bulk.particle_state import Beads, Grains
    from rigtwin.sim.output.replay import Frame

# a photo of a bowl only shows the part of the heap above the rim, so its angles differ from those counted here
COUNTED_FROM = "counted from the base plate, also where a rim hides it from the side"


@dataclass(frozen=True)
class Heap:
    """The heap on the base at the end.  x and y from the axis of the disc, z above its top face."""

    centres: Array  # [m], shape (n, 3), of the spheres that stay on the base
    radii: Array  # [m], shape (n,)
    radius: float  # [m], of a particle; for a clump of its bounding sphere
    profiles: tuple[Profile, ...]  # silhouettes from four sides; for an emptied container sections, back to back
    base_diameter: float  # [m], width of the base in the profiles
    at_rest: bool
    time: float  # [s], simulated
    asked: int
    placed: int
    fallen: int  # over the rim, or through the drain
    bed_height: float | None = None  # [m], mean surface of the bed in the tube of a pouring, before it is lifted
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
    """Form a heap by the method of `rig.variant` and wait until it rests.

    Parameters
    ----------
    rig : Pile
        Variant ("piling", "pouring" or "emptying") and dimensions [m].
    particle : Particle
        Sphere or clump.
    wall : Material
        Material of base, tube and container.
    contact, wall_contact : Contact
        Coefficients of contacts between particles, and of particles with walls.
    count : int
        Number of particles.
    seed : int
        Seed of the random positions and orientations.
    pour_rate : float, optional
        Piling: particles per second [1/s].  Default: Beverloo's discharge of the outlet, raised to at most 400 per
        second as long as the initial speed adds no more than the fall.
    fall_height : float, optional
        Piling: height [m] of the outlet above the top of the heap, with which it rises.  Default: three bead
        diameters.  Not used if `rig.outlet_height` fixes the outlet.
    fill_limit : float
        Pouring, emptying: longest wait [s] until the filling rests before it is released.
    settle_limit : float
        Longest wait [s] until the heap rests: after the last bead was poured, the tube was clear of the beads, or the
        drain was opened.
    progress : Progress
        Callback for the progress display.
    **numerics : Numerics
        Numerical settings, see `rigtwin.sim.run.set_up.Numerics`.

    Returns
    -------
    Heap
        The heap at the end; `Heap.at_rest` states whether it rests, `Heap.warnings` what limits the result.

    Raises
    ------
    BadInput
        If a setting is out of its range, or beads or tube would move too fast for the time step.
    SimulationFailed
        If the simulation breaks down.

    Notes
    -----
    Beads that leave the base fall out of the domain and are removed.

    References
    ----------
    Hlosta et al. 2020, fig. 5a.
    """
    _check(rig, particle, count, settle_limit)
    bench = Bench(rig, particle, wall, contact, wall_contact, numerics)
    method = method_of(rig, particle, count, pour_rate, fall_height, fill_limit)
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
    grains = bulk.grains()
    return _heap(
        rig,
        particle,
        method,
        course,
        bulk.beads(),
        grains,
        asked=count,
        at_rest=at_rest,
        time=bulk.time,
        statistics={**logbook.statistics(), "contacts_per_bead": 2 * bulk.contacts / max(len(grains.ident), 1)},
        history=logbook.history,
        assumptions={**method.assumptions, **bench.assumptions(), "heights_and_angles": COUNTED_FROM},
        warnings=bench.warnings(bulk, logbook),
    )


def replayed(
    rig: Pile,
    particle: Particle,
    frame: Frame,
    *,
    asked: int,
    in_time: bool,
    pour_rate: float | None = None,
    fill_limit: float = 3.0,
    filled: Frame | None = None,
) -> Heap:
    """The heap of a run that another program computed.

    Parameters
    ----------
    rig : Pile
        Variant and dimensions [m].
    particle : Particle
        The sphere.
    frame : Frame
        The spheres at the end.
    asked : int
        Number of particles that were poured.
    in_time : bool
        Whether a filling was at rest when it was released.
    pour_rate : float, optional
        Particles per second [1/s], as in `run`.
    fill_limit : float
        Longest wait [s] for the filling, as in `run`.
    filled : Frame, optional
        Pouring: the spheres as the tube begins to move.

    Returns
    -------
    Heap
        The heap at the end, as `run` gives it.
    """
    method = method_of(rig, particle, asked, pour_rate, None, fill_limit)
    course = Course(random=np.random.default_rng(0), placed=asked, in_time=in_time)
    if filled is not None and isinstance(method, Pouring):
        beads = filled.beads(particle)
        course.bed_height = method.bed_height(beads.position, beads.radius)
    grains = frame.grains(particle)
    return _heap(
        rig, particle, method, course, frame.beads(particle), grains, asked=asked,
        at_rest=filling.resting(grains, particle), time=frame.time, statistics={}, history=None,
        assumptions={**method.assumptions, "heights_and_angles": COUNTED_FROM}, warnings=(),
    )  # fmt: skip


def _heap(
    rig: Pile,
    particle: Particle,
    method: Method,
    course: Course,
    beads: Beads,
    grains: Grains,
    *,
    asked: int,
    at_rest: bool,
    time: float,
    statistics: dict[str, float],
    history: History | None,
    assumptions: dict[str, str],
    warnings: tuple[str, ...],
) -> Heap:
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
        time=time,
        asked=asked,
        placed=course.placed,
        fallen=course.placed - int(stays.sum()),
        bed_height=course.bed_height,
        statistics=statistics,
        history=history,
        assumptions=assumptions,
        warnings=(*warnings, *method.warnings(course, grains.position[stays]), *moved),
    )


class Method(Protocol):
    """One way of making a heap."""

    @property
    def shapes(self) -> Any:
        """Walls, as `rigtwin.sim.run.set_up.Bench.bulk` takes them."""

    @property
    def domain(self) -> Any:
        """Low and high corner [m] of the domain."""

    @property
    def settings(self) -> dict[str, Any]:
        """Settings that decide the outcome of a run, for its checkpoint."""

    @property
    def assumptions(self) -> dict[str, str]:
        """What the rig's description leaves open, in words by name."""

    def need_bearable(self, fastest: float, *, falls_freely: bool) -> None:
        """Refuse beads or walls that would move too fast for the time step.

        Parameters
        ----------
        fastest : float
            Largest speed [m/s] that the time step allows.
        falls_freely : bool
            Whether gravity alone acts on falling beads.

        Raises
        ------
        BadInput
            If something would move faster.
        """

    def form(self, bulk: Any, logbook: Any, course: Course, progress: Progress) -> None:
        """Form the heap.

        Parameters
        ----------
        bulk, logbook, course : Bulk, Logbook, Course
            Simulation, its log, and the state of the run.
        progress : Progress
            Callback for the progress display.
        """

    def warnings(self, course: Course, staying: Array) -> list[str]:
        """Warn about what limits the result.

        Parameters
        ----------
        course : Course
            State of the run at its end.
        staying : ndarray, shape (n, 3)
            Centres [m] of the particles that stay on the base.

        Returns
        -------
        list of str
            The warnings.
        """


def method_of(
    rig: Pile, particle: Particle, count: int, rate: float | None, fall_height: float | None, fill_limit: float
) -> Method:
    """Return the way of `rig.variant` of making a heap.

    Parameters
    ----------
    rig, particle, count : Pile, Particle, int
        As for `run`.
    rate : float or None
        Piling: `pour_rate` of `run` [1/s].
    fall_height : float or None
        Piling: as for `run` [m].
    fill_limit : float
        Pouring, emptying: as for `run` [s].

    Returns
    -------
    Method
        Walls, domain and course of the test.

    Raises
    ------
    BadInput
        If there is no such variant, or a setting is out of its range.
    """
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
    """Draw the heap on its base.

    The near half of an emptied container is cut away to show the crater.

    Parameters
    ----------
    rig : Pile
        As for `run`.
    heap : Heap
        Heap at the end of a run.
    turn : float
        Direction of view [deg] about z.
    tilt : float
        Height of the view above the horizon [deg].

    Returns
    -------
    ndarray, shape (height, width, 3)
        RGB image.
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
    """Refuse settings that `run` would refuse, without simulating.

    Parameters
    ----------
    rig, particle, count : Pile, Particle, int
        As for `run`.

    Raises
    ------
    BadInput
        If a setting is out of its range; the message names it.
    """
    _check(rig, particle, count, settle_limit=1.0)
    method_of(rig, particle, count, None, None, fill_limit=1.0)


def _check(rig: Pile, particle: Particle, count: int, settle_limit: float) -> None:
    positive(base_diameter=rig.base_diameter, settle_limit=settle_limit)
    if rig.base_diameter < 4 * particle.diameter:
        raise BadInput(
            f"base_diameter: {rig.base_diameter * 1e3:.3g} mm is too small a base for a heap of beads of "
            f"{particle.diameter * 1e3:.3g} mm; give at least four bead diameters."
        )
    if not (math.isfinite(rig.rim_height) and rig.rim_height >= 0):
        raise BadInput(f"rim_height: {rig.rim_height:g} m is not a height; give zero or more.")
    if rig.rim_height > rig.base_diameter:
        raise BadInput(
            f"rim_height: {rig.rim_height * 1e3:.0f} mm is more than the base diameter of "
            f"{rig.base_diameter * 1e3:.3g} mm; give the height of the rim above the base."
        )
    if count < 1:
        raise BadInput(f"count: {count} beads make no heap; give at least 1.")
