"""Twins of the rigs that hold many particles: pile, packed cylinder, drum, hopper."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple, Unpack

import numpy as np
import numpy.typing as npt

from rigtwin.compare.doubts import spoilt, warned
from rigtwin.compare.twin import Twin, settings_of, stated
from rigtwin.lab.drum import froude_check
from rigtwin.lab.errors import BadInput, NothingToMeasure
from rigtwin.lab.materials import PACKING, Contact, Material, Particle
from rigtwin.lab.progress import Progress, silent
from rigtwin.lab.quantity import Evaluation, Quantity, doubted, failed
from rigtwin.lab.records import Profile, Series
from rigtwin.lab.rigs import Drum, Hopper, Packing, Pile

if TYPE_CHECKING:
    from rigtwin.sim.bench import Numerics
    from rigtwin.sim.hopper import Discharge


class Cast(NamedTuple):
    """Who takes part in a rig of many particles."""

    particle: Particle
    wall: Material
    contact: Contact  # among the particles
    wall_contact: Contact


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
    """A heap of `count` particles on a round base, its profile seen from the sides.

    `pour_rate` [1/s], `fall_height` [m] and limits [s] as in `rigtwin.sim.pile.run`.
    """
    from rigtwin.sim import pile

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
    from rigtwin.measure import pile as ruler  # not before the run, which begins the sooner

    evaluation = ruler.evaluate(heap.profiles, base_diameter=heap.base_diameter, bead_diameter=cast.particle.diameter)
    course = {"asked": heap.asked, "placed": heap.placed, "fallen": heap.fallen, "at_rest": heap.at_rest}
    shown = heap.profiles, (), lambda: pile.picture(rig, heap)
    return _twin("pile", rig, cast, heap, evaluation, begun, seed, numerics, course, *shown)


def packing_twin(
    rig: Packing,
    cast: Cast,
    *,
    count: int,
    seed: int,
    pour_rate: float | None = None,
    fill_limit: float | None = None,
    settle_limit: float | None = None,
    progress: Progress = silent,
    **numerics: Unpack[Numerics],
) -> Twin:
    """A bed of `count` particles poured into a cylinder, its surface seen from the sides.

    `pour_rate` [1/s] and limits [s] as in `rigtwin.sim.packing.run`.
    """
    from rigtwin.sim import packing
    from rigtwin.sim.fill import arch_in_words

    begun = time.perf_counter()
    waits = stated(fill_limit=fill_limit, settle_limit=settle_limit)
    bed = packing.run(rig, *cast, count=count, seed=seed, pour_rate=pour_rate, progress=progress, **waits, **numerics)
    from rigtwin.measure import packing as ruler  # not before the run, which begins the sooner

    try:
        evaluation = ruler.evaluate(
            bed.profiles,
            cylinder_diameter=rig.cylinder_diameter,
            total_mass=bed.mass,
            bead_diameter=cast.particle.diameter,
        )
    except BadInput as error:
        if bed.arched:
            jam = arch_in_words(f"{bed.stuck} of {bed.placed} particles", bed.outlet_diameter, cast.particle)
            raise BadInput(f"outlet_diameter: {jam}, and leave no bed below; give a wider one.") from error
        layer = _one_layer(rig, cast.particle)
        if bed.stuck or bed.placed - bed.missed >= layer:
            raise
        raise BadInput(
            f"a count of {count} makes no bed: about {layer} cover the floor of a cylinder of "
            f"{rig.cylinder_diameter * 1e3:.3g} mm once; give several times as many."
        ) from error
    course = {
        "asked": bed.asked,
        "placed": bed.placed,
        "missed": bed.missed,
        "stuck": bed.stuck,
        "at_rest": bed.at_rest,
        "surface_height_m": bed.height,
        "packing_fraction": bed.packing_fraction,
        "seconds_per_particle": bed.seconds_per_particle,
    }
    shown = bed.profiles, (), lambda: packing.picture(rig, bed)
    twin = _twin("packing", rig, cast, bed, evaluation, begun, seed, numerics, course, *shown)
    each = bed.seconds_per_particle
    if math.isnan(each):
        return replace(twin, cost="not known: the checkpoint was written by an earlier rigtwin")
    return replace(twin, cost=f"{each:.3g} s of processor time per particle")


def drum_twin(
    rig: Drum,
    cast: Cast,
    *,
    seed: int,
    count: int | None = None,
    turns: float = 1.0,
    fill_limit: float | None = None,
    progress: Progress = silent,
    **numerics: Unpack[Numerics],
) -> Twin:
    """A bed in a drum that turns `turns` times, its surface seen along the axis; `fill_limit` [s] as in its `run`."""
    from rigtwin.sim import drum

    begun = time.perf_counter()
    waits = stated(fill_limit=fill_limit)
    rotation = drum.run(rig, *cast, count=count, turns=turns, seed=seed, progress=progress, **waits, **numerics)
    from rigtwin.measure import drum as ruler  # not before the run, which begins the sooner

    checks = drum.checks(rig, cast.particle, rotation)
    try:
        evaluation = ruler.evaluate(
            rotation.profiles[1:],  # without the bed at rest
            rotation.time[1:],
            drum_diameter=rig.diameter,
            speed=abs(rig.speed),
            bead_diameter=cast.particle.diameter,
        )
    except NothingToMeasure as error:
        flows = froude_check(rig.speed, rig.diameter / 2)
        if not flows.passed:
            raise BadInput(f"speed: {flows.message}") from error
        if why := failed(checks, {"fill", "beads_enough"}):
            raise BadInput(f"{'fill' if count is None else 'count'}: {why}.") from error
        raise
    angles = tuple(doubted(one, failed(checks)) for one in evaluation.quantities)
    mixed = (rotation.mixed.quantity(turns),) if math.isfinite(rotation.mixed.index) else ()
    evaluation = replace(evaluation, quantities=(*angles, *mixed), checks=(*checks, *evaluation.checks))
    over_time = ruler.angles_over_time(rotation.profiles, rotation.time, drum_diameter=rig.diameter)
    course = {
        "count": rotation.count,
        "turns": rotation.turns,
        "steady_from_s": rotation.steady_from,
        "mixing_index": float(rotation.mixing.value[-1]),
    }
    shown = (rotation.steady,), (rotation.mixing, *over_time), lambda: drum.picture(rig, rotation)
    twin = _twin("drum", rig, cast, rotation, evaluation, begun, seed, numerics, course, *shown)
    return replace(twin, surfaces=rotation.profiles)


def hopper_twin(
    rig: Hopper,
    cast: Cast,
    *,
    count: int,
    seed: int,
    duration: float | None = None,
    fill_limit: float | None = None,
    settle_limit: float | None = None,
    progress: Progress = silent,
    **numerics: Unpack[Numerics],
) -> Twin:
    """A hopper of `count` particles that empties, watched for `duration` [s] or until nothing leaves any more.

    Limits [s] as in `rigtwin.sim.hopper.run`.
    """
    from rigtwin.sim import hopper

    begun = time.perf_counter()
    waits = stated(fill_limit=fill_limit, settle_limit=settle_limit)
    discharge = hopper.run(
        rig, *cast, count=count, seed=seed, duration=duration, progress=progress, **waits, **numerics
    )
    from rigtwin.measure import hopper as ruler  # not before the run, which begins the sooner

    try:
        evaluation = ruler.evaluate(discharge.mass_left, total_mass=count * cast.particle.mass, opened=0.0)
    except BadInput as error:
        if why := _no_flow(rig, cast.particle, discharge, duration):
            raise BadInput(why) from error
        raise
    if discharge.arched or failed(evaluation.checks, {"emptied"}):
        evaluation = _not_emptied(evaluation, discharge)
    course = {
        "asked": discharge.asked,
        "emptied": discharge.emptied,
        "remaining": discharge.remaining,
        "last_bead_s": discharge.discharge_time,
        "mass_flow_rate_kg_s": discharge.mass_flow_rate,
    }
    heap = () if discharge.pile is None else (discharge.pile,)
    shown = heap, (discharge.mass_left,), lambda: hopper.picture(rig, cast.particle, discharge)
    return _twin("hopper", rig, cast, discharge, evaluation, begun, seed, numerics, course, *shown)


def cylinder_for(rig: Packing, particle: Particle, count: int) -> Packing:
    """The rig with a measuring cylinder that holds `count` particles with room to spare."""
    loose = 2.2 * count * particle.mass / particle.effective_density / (math.pi / 4 * rig.cylinder_diameter**2)
    return replace(rig, cylinder_height=max(rig.cylinder_height, loose))


def _one_layer(rig: Packing, particle: Particle) -> int:
    """How many particles cover the cylinder's floor once."""
    return math.ceil(PACKING * math.pi / 4 * rig.cylinder_diameter**2 * particle.diameter / particle.volume)


def _not_emptied(evaluation: Evaluation, discharge: Discharge) -> Evaluation:
    """Times of a hopper that holds particles still are doubtful, and where these arch over its outlet all that left."""
    why = next(sentence for sentence in warned({"warnings": discharge.warnings}) if sentence.startswith("only "))

    def doubtful(one: Quantity) -> bool:
        if one.quantity == "opening_time":
            return False
        return discharge.arched or (one.unit == "s" and not one.doubtful)

    return replace(
        evaluation, quantities=tuple(doubted(one, why) if doubtful(one) else one for one in evaluation.quantities)
    )


def _no_flow(rig: Hopper, particle: Particle, discharge: Discharge, duration: float | None) -> str:
    """What setting is to blame where no discharge can be read from the run; empty where it is none of those."""
    from rigtwin.measure.hopper import STAYS
    from rigtwin.sim.fill import arch_in_words
    from rigtwin.sim.hopper import STUCK

    end = float(discharge.mass_left.time[-1])
    if discharge.emptied == discharge.asked:
        return (
            f"a count of {discharge.asked} makes no flow: all is out after {end:.2g} s; "
            "give more particles or a narrower outlet."
        )
    stay = f"{discharge.remaining} of {discharge.asked} particles"
    if discharge.arched:
        return f"outlet: {arch_in_words(stay, rig.outlet, particle)}; give a wider one."
    latest = float(discharge.outlet_times[-1]) if discharge.emptied else 0.0
    if duration is not None and end >= duration and end - latest <= STUCK:
        return (
            f"duration: {duration:g} s after the opening {discharge.emptied} of {discharge.asked} particles have left "
            "and more are on their way; give a longer duration, or none to wait until the flow has stopped."
        )
    if discharge.remaining < STAYS * discharge.asked:
        return ""
    return f"{stay} stay in the hopper around its outlet; give steeper walls or a wider outlet."


def _twin(
    name: str,
    rig: Pile | Packing | Drum | Hopper,
    cast: Cast,
    run: Any,
    evaluation: Evaluation,
    begun: float,
    seed: int,
    numerics: Numerics,
    course: Mapping[str, Any],
    profiles: tuple[Profile, ...] = (),
    series: tuple[Series, ...] = (),
    draw: Callable[[], npt.NDArray[np.uint8]] | None = None,
) -> Twin:
    """The twin of a `run` that began at `begun` [s] and went as `course` says."""
    if "at_rest" in course:  # a bed or a heap
        why = "; ".join(spoilt({"warnings": run.warnings, **course}))
        evaluation = replace(evaluation, quantities=tuple(doubted(one, why) for one in evaluation.quantities))
    particle, wall = cast.particle, cast.wall
    contacts = {f"{particle.name}-{particle.name}": cast.contact, f"{particle.name}-{wall.name}": cast.wall_contact}
    return Twin(
        name,
        evaluation,
        settings_of(
            rig, particle, contacts, threads=numerics.get("threads"), seed=seed, **course, statistics=run.statistics
        ),
        profiles=profiles,
        series=series,
        assumptions=tuple(f"{about.replace('_', ' ')}: {what}" for about, what in run.assumptions.items()),
        warnings=tuple(run.warnings),
        seconds=time.perf_counter() - begun,
        draw=draw,
    )
