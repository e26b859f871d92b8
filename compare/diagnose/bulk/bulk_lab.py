"""A lab of rigs with many particles, ready for diagnosis: conditions, records, and stated values with uncertainties."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from rigtwin.lab.arrays import Array
from rigtwin.lab.file.lab_file import Experiment
from rigtwin.lab.file.model_file import Model
from rigtwin.lab.materials import Contact

SIMULATED_MODULUS = 1e7  # [Pa], largest Young's modulus of the twins, to keep runs short
FRICTION_STD = 0.02  # [1], standard uncertainty of a coefficient of friction where the lab states none
RESTITUTION_STD = 0.02  # [1]
SIZE_STD = 0.01  # relative, of the diameter


@dataclass(frozen=True)
class Record:
    """One repetition: a curve and single numbers.

    Parameters
    ----------
    x, y : ndarray or None
        Outline or surface [m], or time [s] and mass that has left [kg].
    numbers : mapping of str to float
        Of `rigtwin.compare.diagnose.bulk.observables.NUMBERS`, in SI.
    """

    x: Array | None
    y: Array | None
    numbers: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class BulkCondition:
    """One setting of a rig with its repetitions."""

    experiment: Experiment
    records: tuple[Record, ...]

    @property
    def name(self) -> str:
        return self.experiment.id

    @property
    def rig(self) -> str:
        return self.experiment.rig_name


@dataclass(frozen=True)
class Uncertain:
    """Standard uncertainties of what the lab states."""

    friction: float = FRICTION_STD
    restitution: float = RESTITUTION_STD
    rolling: float = 0.0  # [1]; 0: not measured, so that a value is an effect
    diameter_rel: float = SIZE_STD
    scale_rel: float = 0.003
    roll: float = 0.0026  # [rad], 0.15 degrees
    clock_rel: float = 1e-4


@dataclass(frozen=True)
class BulkLab:
    """Conditions of one or several rigs with one model."""

    title: str
    folder: Path
    conditions: tuple[BulkCondition, ...]
    model: Model
    uncertain: Uncertain
    arm: float
    """Rolling friction among the particles over that at walls if one coefficient is meant: 1/2 where a lab counts with
    the effective radius, 1 with the particle's own."""
    left_out: tuple[str, ...] = ()

    @property
    def rigs(self) -> str:
        """Names of the rigs in words."""
        return " and ".join(dict.fromkeys(one.rig for one in self.conditions))

    @property
    def repetitions(self) -> int:
        return sum(len(one.records) for one in self.conditions)

    def contacts(self, condition: BulkCondition) -> tuple[Contact, Contact]:
        """The stated contacts of a condition, at the wall and among the particles."""
        wall, like = condition.experiment.contacts
        return self.model.contact(*wall), self.model.contact(*like)

    def stiffness_factor(self, condition: BulkCondition) -> float:
        """Factor on the moduli of its twins."""
        return min(1.0, SIMULATED_MODULUS / condition.experiment.particle.material.youngs_modulus)
