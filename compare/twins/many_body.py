"""Shared parts of the twins with many particles: pile, packing, drum and hopper."""

from __future__ import annotations

import time
from abc import abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple, Protocol

import numpy as np
import numpy.typing as npt

from rigtwin.compare.twins import run_cost
from rigtwin.compare.twins.rig_entry import RigEntry, Settings, Stated
from rigtwin.compare.twins.run_warnings import spoilt
from rigtwin.compare.twins.twin import Twin, settings_of
from rigtwin.lab.custom_rig import CustomRig
from rigtwin.lab.errors import BadInput, TwinLacks
from rigtwin.lab.materials import Contact, Material, Particle, very_small
from rigtwin.lab.quantity import Evaluation, doubted
from rigtwin.lab.records import Profile, Series
from rigtwin.lab.reference import hlosta2020
from rigtwin.lab.rigs import Rig

if TYPE_CHECKING:
    from rigtwin.lab.file.lab_file import Experiment
    from rigtwin.lab.file.model_file import Effects, Model
    from rigtwin.lab.progress import Progress
    from rigtwin.lab.quantity import Measurement


NUMERICS = ("contact_law", "stiffness_factor", "time_step", "rolling_resistance", "effects")
"""Assumptions of a run that are numerical settings (`rigtwin.sim.run.set_up.Bench.assumptions`)."""


class Computed(NamedTuple):
    """How a run was computed."""

    begun: float  # start on the performance counter [s]
    seed: int
    threads: int | None = None  # None: all
    by: str = ""  # another program than rigtwin


class Cast(NamedTuple):
    """Particle, wall and contacts of a rig with many particles."""

    particle: Particle
    wall: Material
    contact: Contact  # among the particles
    wall_contact: Contact


def bulk_twin(
    name: str,
    rig: Rig | CustomRig,
    cast: Cast,
    run: Any,
    evaluation: Evaluation,
    computed: Computed,
    course: Mapping[str, Any],
    profiles: tuple[Profile, ...] = (),
    series: tuple[Series, ...] = (),
    draw: Callable[[], npt.NDArray[np.uint8]] | None = None,
) -> Twin:
    """The twin of a finished `run`.

    `course` holds particle numbers and other results of the run.
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
            rig,
            particle,
            contacts,
            threads=computed.threads,
            computed_by=computed.by,
            seed=computed.seed,
            numerics={name: run.assumptions[name] for name in NUMERICS if name in run.assumptions},
            **course,
            statistics=run.statistics,
        ),
        profiles=profiles,
        series=series,
        assumptions=tuple(f"{about.replace('_', ' ')}: {what}" for about, what in run.assumptions.items()),
        warnings=(*run.warnings, *([odd] if (odd := very_small(particle)) else [])),
        seconds=time.perf_counter() - computed.begun,
        draw=draw,
    )


class ManyBodyEntry(RigEntry[Settings]):
    """A rig of many particles: its twin waits for no measurement, and is filled as stated."""

    many_particles: ClassVar[bool] = True

    @abstractmethod
    def count(self, experiment: Experiment, count: int | None) -> int | None:
        """Return how many particles the twin has: by the lab file, else `count`; None where another setting says so."""

    @abstractmethod
    def check_count(self, experiment: Experiment, count: int | None) -> None:
        """Raise `BadInput` where the simulation would refuse its settings with so many particles."""

    @abstractmethod
    def filled_twin(self, experiment: Experiment, cast: Cast, count: int | None, **run: Any) -> Twin:
        """Run the twin of so many particles."""

    def check(self, experiment: Experiment, *, model: Model, frame_rate: float | None, count: int | None) -> None:
        self.check_count(experiment, self.count(experiment, count))

    def twin(
        self,
        experiment: Experiment,
        contacts: Sequence[Contact],
        *,
        measurements: Sequence[Measurement],
        start: float | None,
        count: int | None,
        seed: int,
        effects: Effects,
        progress: Progress,
        numerics: dict[str, Any],
    ) -> Twin:
        assert experiment.wall is not None  # the lab file demands a wall for these rigs
        cast = Cast(experiment.particle, experiment.wall, contacts[1], contacts[0])
        filled = self.count(experiment, count)
        if filled is not None and filled >= run_cost.MANY:
            softer = numerics.get("stiffness_factor") or hlosta2020.SOFTENING
            cost = run_cost.in_words(experiment.particle, filled, stiffness_factor=softer)
            progress(f"twin of {experiment.id}: {cost}", 0, 0)
        return self.filled_twin(experiment, cast, filled, seed=seed, effects=effects, progress=progress, **numerics)


class Weighed(Protocol):
    """Settings of a rig whose filling is weighed or counted."""

    @property
    def total_mass(self) -> float | None: ...  # [kg]
    @property
    def count(self) -> int | None: ...


def filling_mass(rig: Weighed, particle: Particle) -> float | None:
    """[kg] of all particles: as weighed, else as counted times the mass of one."""
    if rig.total_mass is None and rig.count is not None:
        return rig.count * particle.mean_mass
    return rig.total_mass


def filling_count(rig: Weighed, particle: Particle, count: int | None) -> int:
    """Return how many particles: as counted, else as weighed, else `count`.  Raises `BadInput` where none is known."""
    weighed = None if rig.total_mass is None else round(rig.total_mass / particle.mean_mass)
    if weighed == 0 and not rig.count:
        raise BadInput("total_mass: is less than half the mass of one particle; state the mass of all particles.")
    if weighed is not None and not rig.count:
        origin = f"the stated mass over {particle.mean_mass * 1e3:.3g} g of a particle"
        run_cost.need_usual_number("total_mass", weighed, particle, origin, "the mass and the particle")
    filled = rig.count or weighed or count
    if not filled:
        raise TwinLacks("the number of particles is not known; add total_mass or count to the experiment.")
    return filled


def stated_filling(rig: Weighed) -> Stated:
    """Return the filling as the report shows it: its mass, or the number of particles."""
    if rig.total_mass is not None:
        return Stated("filling", rig.total_mass, 1e3, " g")
    return Stated("filling", rig.count, 1, " particles")
