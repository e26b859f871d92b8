"""A global unknown of a fit with its prior."""

from __future__ import annotations

import math
from dataclasses import dataclass


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
