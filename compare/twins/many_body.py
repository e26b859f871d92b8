"""Shared parts of the twins with many particles: pile, packing, drum and hopper."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import numpy.typing as npt

from rigtwin.compare.twins.run_warnings import spoilt
from rigtwin.compare.twins.twin import Twin, settings_of
from rigtwin.lab.materials import Contact, Material, Particle
from rigtwin.lab.quantity import Evaluation, doubted
from rigtwin.lab.records import Profile, Series
from rigtwin.lab.rigs import Drum, Hopper, Packing, Pile

if TYPE_CHECKING:
    from rigtwin.sim.run.set_up import Numerics


class Cast(NamedTuple):
    """Particle, wall and contacts of a rig with many particles."""

    particle: Particle
    wall: Material
    contact: Contact  # among the particles
    wall_contact: Contact


def bulk_twin(
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
    """The twin of a finished `run`.

    `begun` is the start on the performance counter [s], `course` holds particle numbers and other results of the run.
    """
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
