"""Set-up of a bulk simulation: particles, walls, numerical settings, and the log of the run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypedDict

import numpy as np

from rigtwin.lab.arrays import Array
from rigtwin.lab.custom_rig import CustomRig
from rigtwin.lab.errors import BadInput
from rigtwin.lab.file.model_file import NO_EFFECTS, Effects
from rigtwin.lab.materials import Contact, Material, Particle
from rigtwin.lab.rigs import Rig
from rigtwin.lab.units import positive
from rigtwin.sim.engine.time_step import USUAL, time_step

if TYPE_CHECKING:
    from rigtwin.sim.engine.bulk.bulk import Bulk
    from rigtwin.sim.engine.contact import ContactLaw, Rolling
    from rigtwin.sim.engine.device import Device
    from rigtwin.sim.engine.effect_terms import Active
    from rigtwin.sim.engine.walls.shapes import Shape, Wall
    from rigtwin.sim.run.run_log import Logbook


FRAME_INTERVAL = 0.01  # [s]
CHECKPOINT_INTERVAL = 60.0  # [s] of computing time that a power cut may lose
OVERLAP_LIMIT = 0.05  # overlap over radius; softer contacts change the result


class Numerics(TypedDict, total=False):
    """Numerical settings of a bulk simulation, which have no counterpart in the experiment."""

    stiffness_factor: float  # factor of Young's moduli; default 0.001 (Hlosta et al. 2020, section 2.2.3)
    time_step_fraction: float  # time step over Rayleigh's; default 0.3
    forced: bool  # accept even an unstable time step
    device: Device  # default: see `usual_device`; "cuda" falls back to the CPU with a warning, "auto" without one
    rolling: Rolling  # default "type C"
    contact_law: ContactLaw  # default "Hertz-Mindlin"
    impact_speed: float  # [m/s], at which springs of the "linear" law are as stiff as Hertz's contacts; default 1 m/s
    effects: Effects  # effects of a model by name
    threads: int | None  # None: all cores
    trajectory: Path | None  # .gsd or .vtkhdf; the walls are written to <stem>-walls.vtk
    trajectory_interval: float  # [s], simulated time
    checkpoint: Path | None  # an existing file is resumed, with bit-identical results
    checkpoint_interval: float  # [s], computing time


@dataclass(frozen=True)
class Bench:
    """A rig, its particles and walls, and the numerical settings."""

    rig: Rig | CustomRig
    particle: Particle
    wall: Material
    contact: Contact
    wall_contact: Contact
    numerics: Numerics

    def __post_init__(self) -> None:
        positive(stiffness_factor=self.stiffness_factor)
        if self.stiffness_factor > 1:
            raise BadInput(
                f"stiffness_factor: {self.stiffness_factor:g} is above 1; give at most 1, the real stiffness."
            )
        self.time_step()
        positive(impact_speed=self.impact_speed)  # last: its default imports the engine

    @property
    def stiffness_factor(self) -> float:
        """Factor of Young's moduli [1]."""
        return self.numerics.get("stiffness_factor", 1e-3)

    @property
    def rolling(self) -> Rolling:
        """Rolling resistance model."""
        return self.numerics.get("rolling", "type C")

    @property
    def contact_law(self) -> ContactLaw:
        """Contact law."""
        return self.numerics.get("contact_law", "Hertz-Mindlin")

    @property
    def impact_speed(self) -> float:
        """Speed [m/s] of the impact at which springs of the "linear" law are as stiff as Hertz's contacts."""
        from rigtwin.sim.engine.contact import IMPACT_SPEED

        return self.numerics.get("impact_speed", IMPACT_SPEED)

    @property
    def soft(self) -> Particle:
        """The particle with softened moduli, as it is simulated."""
        return replace(self.particle, material=self.particle.material.softened(self.stiffness_factor))

    def time_step(self) -> tuple[float, tuple[str, ...]]:
        """Time step [s] and warnings about it."""
        fraction, forced = self.numerics.get("time_step_fraction", USUAL), self.numerics.get("forced", False)
        lowest = min(self.contact.restitution, self.wall_contact.restitution)
        return time_step([self.soft], fraction, forced=forced, restitution=lowest)

    @property
    def fastest(self) -> float:
        """Largest speed [m/s] of a bead or a wall; a faster one moves too far in a step and misses contacts."""
        from rigtwin.sim.engine.bulk.bulk import STEP_IN_RADII

        return STEP_IN_RADII * self.soft.smallest_radius / self.time_step()[0]

    @property
    def falls_freely(self) -> bool:
        """Whether gravity alone acts on falling particles, without forces of effects such as air drag."""
        from rigtwin.sim.engine.effect_terms import acting_among

        active, _ = acting_among(self.numerics.get("effects", NO_EFFECTS), self.particle)
        return all(one.effect.force is None for one in active)

    def bulk(
        self,
        shapes: Sequence[Shape],
        domain: tuple[Sequence[float] | Array, Sequence[float] | Array],
        *,
        skin: float | None = None,
        open_domain: bool = True,
        static_friction: Mapping[int, float | None] | None = None,
    ) -> Bulk:
        """Return a simulation without beads.

        Parameters
        ----------
        shapes : sequence of Shape
            The walls, all of the material of `wall`.
        domain : tuple
            Low and high corner [m].
        skin : float, optional
            Verlet skin.  Default: that of the engine.
        open_domain : bool
            Whether beads that leave the domain are removed; if not, they stop the run with an error.
        static_friction : mapping of int to float, optional
            Static friction [1] of single walls, by their number, where it is not that of `wall_contact`.

        Returns
        -------
        Bulk
            The simulation.
        """
        from rigtwin.sim.engine.walls.shapes import Wall

        wall = self.wall.softened(self.stiffness_factor)
        contacts = {
            number: replace(self.wall_contact, static_friction=value)
            for number, value in (static_friction or {}).items()
            if value is not None
        }
        walls = [Wall(shape, wall, contacts.get(number, self.wall_contact)) for number, shape in enumerate(shapes)]
        return self.bulk_of(walls, domain, skin=skin, open_domain=open_domain)

    def bulk_of(
        self,
        walls: Sequence[Wall],
        domain: tuple[Sequence[float] | Array, Sequence[float] | Array],
        *,
        skin: float | None = None,
        open_domain: bool = True,
        weighs: bool = False,
    ) -> Bulk:
        """Return a simulation without beads, with walls that differ.

        Parameters
        ----------
        walls : sequence of Wall
            The walls, each with its material (softened), contact and motion.
        domain, skin, open_domain : tuple, float, bool
            As for `bulk`.
        weighs : bool
            As for `Bulk`.

        Returns
        -------
        Bulk
            The simulation.
        """
        from rigtwin.sim.engine.bulk.bulk import SKIN, Bulk

        (x, y, z), (to_x, to_y, to_z) = ([float(c) for c in corner] for corner in domain)
        return Bulk(
            [self.soft],
            self.contact,
            walls,
            low=(x, y, z),
            high=(to_x, to_y, to_z),
            open_domain=open_domain,
            weighs=weighs,
            time_step=self.time_step()[0],
            rolling=self.rolling,
            contact_law=self.contact_law,
            impact_speed=self.impact_speed,
            effects=self._effects()[0],
            threads=self.numerics.get("threads"),
            device=self.numerics.get("device"),
            skin=SKIN if skin is None else skin,
        )

    def logbook(self, bulk: Bulk, **settings: Any) -> Logbook:
        """Return a log that runs a simulation.

        Parameters
        ----------
        bulk : Bulk
            Simulation that is run and logged.
        **settings : object
            Settings of the rig that decide the outcome, as JSON data.

        Returns
        -------
        Logbook
            The log, with files as the numerical settings state.
        """
        from rigtwin.sim.run.run_log import Logbook

        parts = ("rig", "particle", "wall", "contact", "wall_contact")
        numerics = {
            "stiffness_factor": self.stiffness_factor,
            "time_step_fraction": self.numerics.get("time_step_fraction", USUAL),
            "device": bulk.device,  # devices differ in the last bits
            "rolling": self.rolling,
            **self._lever(),
            "contact_law": self.contact_law,
            "impact_speed": self.impact_speed,
            "effects": {name: dict(values) for name, values in self.numerics.get("effects", NO_EFFECTS).items()},
        }
        return Logbook(
            bulk,
            {**{name: asdict(getattr(self, name)) for name in parts}, **numerics, **settings},
            trajectory=self.numerics.get("trajectory"),
            trajectory_interval=self.numerics.get("trajectory_interval", FRAME_INTERVAL),
            checkpoint=self.numerics.get("checkpoint"),
            checkpoint_interval=self.numerics.get("checkpoint_interval", CHECKPOINT_INTERVAL),
        )

    def assumptions(self) -> dict[str, str]:
        """Numerical settings in words, for the result."""
        from rigtwin.sim.engine.effect_terms import named_in

        linear = f"linear springs, as stiff as Hertz's contacts at {self.impact_speed:g} m/s"
        return {
            "contact_law": linear if self.contact_law == "linear" else self.contact_law,
            "stiffness_factor": f"{self.stiffness_factor:g} of the real Young's moduli of beads and walls",
            "time_step": f"{100 * self.time_step()[0] / self.soft.rayleigh_time_step:g}% of Rayleigh's",
            "rolling_resistance": f"{self.rolling}, torque limit mu_r Fn R on each bead"
            + (", R from a contact to the centre of mass" if self.rolling != "type C" else ""),
            **named_in(self._effects()[0]),
        }

    def warnings(self, bulk: Bulk, logbook: Logbook) -> tuple[str, ...]:
        """Return warnings about the numerical settings of a finished run.

        Parameters
        ----------
        bulk, logbook : Bulk, Logbook
            The simulation and its log.

        Returns
        -------
        tuple of str
            The warnings.
        """
        said = [*self.time_step()[1], *logbook.warnings, *([bulk.note] if bulk.note else [])]
        said += self._effects()[1]
        if bulk.largest_overlap > OVERLAP_LIMIT:
            said.append(pressed(bulk.largest_overlap, logbook.history.largest_overlap))
        return tuple(said)

    def _lever(self) -> dict[str, str]:
        """Setting that separates a clump's run under type A from older ones, which used the touched sphere's radius."""
        if self.rolling == "type C" or self.particle.shape is None:
            return {}
        return {"rolling_lever": "from a contact to the centre of mass"}

    def _effects(self) -> tuple[tuple[Active, ...], tuple[str, ...]]:
        """Effects of the model that act here, and warnings about those that do not."""
        from rigtwin.sim.engine.effect_terms import acting_among

        return acting_among(self.numerics.get("effects", NO_EFFECTS), self.particle)


def pressed(most: float, seen: Array) -> str:
    """Return the warning about soft beads.

    An impact lasts about 0.1 ms; its overlap changes the rebound but not the bed at rest.  An overlap that most checks
    show is not an impact but that of a bed that rests or flows.

    Parameters
    ----------
    most : float
        Largest overlap of the whole run [radii].
    seen : ndarray, shape (n,)
        Largest overlap at each check [radii].

    Returns
    -------
    str
        The warning.
    """
    lasting = float(max(np.median(seen), seen[-1]))
    if lasting > OVERLAP_LIMIT:
        return (
            f"beads lie up to {lasting:.1%} of a radius in each other; "
            f"above {OVERLAP_LIMIT:.0%} give a larger --stiffness-factor"
        )
    return (
        f"impacts pressed beads up to {most:.1%} of a radius together (otherwise {lasting:.1%}); "
        "where rebounds matter give a larger --stiffness-factor"
    )
