"""A global unknown of a fit with its prior, and quantities that differ between repetitions."""

from __future__ import annotations

import math
from dataclasses import dataclass

# largest standard deviations between repetitions that are usual: the largest of Hlosta et al. 2020, tables 8 to 12
USUAL_RESTITUTION = 0.09  # [1]
USUAL_FRICTION = 0.07  # [1], static
USUAL_ROLLING = 0.03  # [1], rolling friction


@dataclass(frozen=True)
class Unknown:
    """A global unknown: a calibration quantity, a contact parameter, or a coefficient of an effect."""

    name: str
    start: float
    step: float
    """Size of a visible change, in the unit of the unknown; sets the finite-difference step."""
    prior: float = 0.0
    sd: float = math.inf
    """Standard deviation of the prior; infinite where nothing is stated."""
    low: float = -math.inf
    high: float = math.inf
    effect: str = ""
    """The effect that the unknown belongs to, empty for the rig's own unknowns."""


@dataclass(frozen=True)
class Scattered:
    """A quantity that differs from repetition to repetition, or from impact to impact."""

    name: str
    unit: str
    usual: float
    """Largest standard deviation that is usual, in the unit."""
