"""Fall of a sphere through air with drag, and an upper limit for its contact time with a plate."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.optimize import brentq

from rigtwin.lab.arrays import Array
from rigtwin.lab.materials import AIR_DENSITY, AIR_VISCOSITY
from rigtwin.lab.rigs import GRAVITY

DWELL = 1.2e-3  # [s], longest contact assumed for a bead of unknown size
SOFTEST = 1e7  # [Pa], effective modulus of the softest pair of bead and plate considered: rubber
USUAL_DENSITY = 1000.0  # [kg/m^3], assumed for a bead of unknown density
NEWTON = 0.44  # drag coefficient of a fast sphere (Newton's regime)


@dataclass(frozen=True)
class AirDrag:
    """Deceleration of a sphere in still air: C_d = 24/Re (1 + 0.15 Re^0.687), at least 0.44.

    Schiller and Naumann (1933), "A drag coefficient correlation"; 0.44 is Newton's regime.

    Without the density the strength k [1/m] is free: the deceleration is (C_d / 0.44) k v^2.  Without the diameter C_d
    is constant as well.
    """

    diameter: float | None = None  # [m]
    density: float | None = None  # [kg/m^3]

    @property
    def known(self) -> bool:
        return self.diameter is not None and self.density is not None

    def deceleration(self, speed: Array, strength: float) -> Array:
        """Deceleration [m/s^2] at speeds [m/s]; `strength` multiplies the known law, or is k [1/m] of the free one."""
        if self.diameter is None:
            return np.asarray(strength * speed**2)
        reynolds = np.maximum(AIR_DENSITY * speed * self.diameter / AIR_VISCOSITY, 1e-9)
        coefficient = np.maximum(24 / reynolds * (1 + 0.15 * reynolds**0.687), NEWTON)
        if self.density is None:
            return np.asarray(strength * coefficient / NEWTON * speed**2)
        return np.asarray(strength * 0.75 * coefficient * AIR_DENSITY * speed**2 / (self.density * self.diameter))


def longest_contact(drag: AirDrag, height: float) -> float:
    """Upper limit of the contact time [s] of a bead with the plate after a fall of `height` [m].

    Hertz: 2.87 (m^2 / (R E^2 v))^(1/5) (Johnson 1985, section 11.4), with the modulus E of rubber.
    """
    if drag.diameter is None:
        return DWELL
    density = USUAL_DENSITY if drag.density is None else drag.density
    radius, speed = drag.diameter / 2, math.sqrt(2 * GRAVITY * height)
    mass = density * 4 / 3 * math.pi * radius**3
    return float(2.87 * (mass**2 / (radius * SOFTEST**2 * speed)) ** 0.2)


class Fall:
    """Fall from rest and the rise to rest (in reversed time), tabulated over speed."""

    _points = 1500

    def __init__(self, drag: AirDrag, strength: float, highest: float) -> None:
        """Build tables that cover at least a fall of `highest` [m]."""
        fastest = 1.4 * math.sqrt(2 * GRAVITY * highest)
        terminal = self._terminal(drag, strength, fastest)
        reach = -math.log1p(-min(fastest / terminal, 1 - 1e-6))
        down = terminal * -np.expm1(-np.linspace(0, reach, self._points))
        self.fall = _Table(down, GRAVITY - drag.deceleration(down, strength))
        # drag shortens a rise: a bead may leave the plate above its terminal speed
        up = np.linspace(0, 3 * fastest, self._points)
        self.rise = _Table(up, GRAVITY + drag.deceleration(up, strength))

    @staticmethod
    def _terminal(drag: AirDrag, strength: float, fastest: float) -> float:
        def surplus(speed: float) -> float:
            return GRAVITY - float(drag.deceleration(np.array([speed]), strength)[0])

        high = 100 * fastest
        return high if surplus(high) > 0 else float(brentq(surplus, 1e-6, high))

    def below_apex(self, time: Array) -> Array:
        """Distance below the apex [m]; `time` [s] is counted from the apex."""
        return np.where(time > 0, self.fall.distance_at(time), self.rise.distance_at(-time))


class _Table:
    def __init__(self, speed: Array, acceleration: Array) -> None:
        self.speed = speed
        # tabulated over speed, not time: both integrals are smooth there, also near the terminal speed
        self.time = _integral(speed, 1 / acceleration)
        self.distance = _integral(speed, speed / acceleration)
        # between table points the acceleration is constant: squared time and speed are linear in the distance
        self._time_square, self._speed_square = self.time**2, speed**2

    def distance_at(self, time: Array) -> Array:
        return np.interp(time**2, self._time_square, self.distance)

    def time_to(self, distance: Array) -> Array:
        """[s]"""
        return np.sqrt(np.interp(distance, self.distance, self._time_square))

    def speed_after(self, distance: float) -> float:
        """[m/s]"""
        return math.sqrt(float(np.interp(distance, self.distance, self._speed_square)))


@lru_cache(maxsize=64)
def tables_of(drag: AirDrag, strength: float, highest: float) -> Fall:
    """Cached tables of a fall: building them takes longer than interpolation."""
    return Fall(drag, strength, highest)


def _integral(x: Array, y: Array) -> Array:
    return np.concatenate([[0.0], np.cumsum((y[1:] + y[:-1]) / 2 * np.diff(x))])
