"""Twins of the rigs that hold many particles: pile, packed cylinder, drum, hopper."""

from __future__ import annotations

import math
import time
from dataclasses import replace
from typing import Any

from rigtwin.compare.twin import Twin, settings_of
from rigtwin.lab.materials import Contact, Material, Particle
from rigtwin.lab.progress import Progress, silent
from rigtwin.lab.reference.hlosta2020 import SOFTENING
from rigtwin.lab.rigs import Drum, Hopper, Packing, Pile


def pile_twin(
    rig: Pile,
    particle: Particle,
    wall: Material,
    contact: Contact,
    wall_contact: Contact,
    *,
    count: int,
    seed: int,
    stiffness_factor: float = SOFTENING,
    threads: int | None = None,
    progress: Progress = silent,
) -> Twin:
    """A heap of `count` particles poured on a round base, its profile seen from the sides."""
    from rigtwin.measure import pile as ruler
    from rigtwin.sim import pile

    begun = time.perf_counter()
    heap = pile.run(
        rig,
        particle,
        wall,
        contact,
        wall_contact,
        count=count,
        seed=seed,
        threads=threads,
        progress=progress,
        stiffness_factor=stiffness_factor,
    )
    evaluation = ruler.evaluate(heap.profiles, base_diameter=rig.base_diameter, bead_diameter=particle.diameter)
    counts = {"asked": heap.asked, "placed": heap.placed, "fallen": heap.fallen, "at_rest": heap.at_rest}
    return Twin(
        "pile",
        evaluation,
        settings_of(rig, particle, _contacts(particle, wall, contact, wall_contact), seed=seed, **counts,
                    statistics=heap.statistics),
        profiles=tuple(heap.profiles),
        assumptions=_words(heap.assumptions),
        warnings=tuple(heap.warnings),
        seconds=time.perf_counter() - begun,
    )  # fmt: skip


def packing_twin(
    rig: Packing,
    particle: Particle,
    wall: Material,
    contact: Contact,
    wall_contact: Contact,
    *,
    count: int,
    seed: int,
    stiffness_factor: float = SOFTENING,
    threads: int | None = None,
    progress: Progress = silent,
) -> Twin:
    """A bed of `count` particles poured into a cylinder, its surface seen from the sides."""
    from rigtwin.measure import packing as ruler
    from rigtwin.sim import packing

    begun = time.perf_counter()
    bed = packing.run(
        rig,
        particle,
        wall,
        contact,
        wall_contact,
        count=count,
        seed=seed,
        stiffness_factor=stiffness_factor,
        threads=threads,
        progress=progress,
    )
    evaluation = ruler.evaluate(
        bed.profiles, cylinder_diameter=rig.cylinder_diameter, total_mass=bed.mass, bead_diameter=particle.diameter
    )
    course: dict[str, Any] = {
        "asked": bed.asked,
        "placed": bed.placed,
        "missed": bed.missed,
        "at_rest": bed.at_rest,
        "surface_height_m": bed.height,
        "packing_fraction": bed.packing_fraction,
        "seconds_per_particle": bed.seconds_per_particle,
    }
    return Twin(
        "packing",
        evaluation,
        settings_of(rig, particle, _contacts(particle, wall, contact, wall_contact), seed=seed, **course,
                    statistics=bed.statistics),
        profiles=tuple(bed.profiles),
        assumptions=_words(bed.assumptions),
        warnings=tuple(bed.warnings),
        seconds=time.perf_counter() - begun,
    )  # fmt: skip


def drum_twin(
    rig: Drum,
    particle: Particle,
    wall: Material,
    contact: Contact,
    wall_contact: Contact,
    *,
    seed: int,
    count: int | None = None,
    turns: float = 1.0,
    stiffness_factor: float = SOFTENING,
    threads: int | None = None,
    progress: Progress = silent,
) -> Twin:
    """A bed in a drum that turns `turns` times, its surface seen along the axis."""
    from rigtwin.measure import drum as ruler
    from rigtwin.sim import drum

    begun = time.perf_counter()
    rotation = drum.run(
        rig,
        particle,
        wall,
        contact,
        wall_contact,
        count=count,
        turns=turns,
        seed=seed,
        stiffness_factor=stiffness_factor,
        threads=threads,
        progress=progress,
    )
    evaluation = ruler.evaluate(
        rotation.profiles,
        rotation.time,
        drum_diameter=rig.diameter,
        speed=abs(rig.speed),
        bead_diameter=particle.diameter,
    )
    course: dict[str, Any] = {
        "count": rotation.count,
        "turns": rotation.turns,
        "steady_from_s": rotation.steady_from,
        "mixing_index": float(rotation.mixing.value[-1]),
    }
    return Twin(
        "drum",
        evaluation,
        settings_of(rig, particle, _contacts(particle, wall, contact, wall_contact), seed=seed, **course,
                    statistics=rotation.statistics),
        profiles=(rotation.steady,),
        series=(rotation.mixing,),
        assumptions=_words(rotation.assumptions),
        warnings=tuple(rotation.warnings),
        seconds=time.perf_counter() - begun,
    )  # fmt: skip


def hopper_twin(
    rig: Hopper,
    particle: Particle,
    wall: Material,
    contact: Contact,
    wall_contact: Contact,
    *,
    count: int,
    seed: int,
    duration: float | None = None,
    stiffness_factor: float = SOFTENING,
    threads: int | None = None,
    progress: Progress = silent,
) -> Twin:
    """A hopper of `count` particles that empties, watched for `duration` [s] or until nothing leaves any more."""
    from rigtwin.measure import hopper as ruler
    from rigtwin.sim import hopper

    begun = time.perf_counter()
    discharge = hopper.run(
        rig,
        particle,
        wall,
        contact,
        wall_contact,
        count=count,
        seed=seed,
        duration=duration,
        stiffness_factor=stiffness_factor,
        threads=threads,
        progress=progress,
    )
    evaluation = ruler.evaluate(discharge.mass_left, total_mass=count * particle.mass, opened=0.0)
    course: dict[str, Any] = {
        "asked": discharge.asked,
        "emptied": discharge.emptied,
        "remaining": discharge.remaining,
        "last_bead_s": discharge.discharge_time,
        "mass_flow_rate_kg_s": discharge.mass_flow_rate,
    }
    return Twin(
        "hopper",
        evaluation,
        settings_of(rig, particle, _contacts(particle, wall, contact, wall_contact), seed=seed, **course,
                    statistics=discharge.statistics),
        profiles=() if discharge.pile is None else (discharge.pile,),
        series=(discharge.mass_left,),
        assumptions=_words(discharge.assumptions),
        warnings=tuple(discharge.warnings),
        seconds=time.perf_counter() - begun,
    )  # fmt: skip


def cylinder_for(diameter: float, particle: Particle, count: int) -> Packing:
    """A measuring cylinder that holds `count` particles with room to spare."""
    usual = Packing(cylinder_diameter=diameter)
    loose = 2.2 * count * particle.mass / particle.effective_density / (math.pi / 4 * diameter**2)
    return replace(usual, cylinder_height=max(usual.cylinder_height, loose))


def _contacts(particle: Particle, wall: Material, contact: Contact, wall_contact: Contact) -> dict[str, Contact]:
    return {f"{particle.name}-{particle.name}": contact, f"{particle.name}-{wall.name}": wall_contact}


def _words(assumptions: dict[str, str]) -> tuple[str, ...]:
    return tuple(f"{name.replace('_', ' ')}: {what}" for name, what in assumptions.items())
