"""A bead falls through air on a plate and bounces: an ordinary differential equation between contacts."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.integrate import solve_ivp

Floats = npt.NDArray[np.float64]

GRAVITY = 9.81  # [m/s^2]
AIR_DENSITY = 1.20  # [kg/m^3]
AIR_VISCOSITY = 1.82e-5  # [Pa s]


def air_drag(velocity: Floats, diameter: float) -> Floats:
    """Drag force on a sphere in still air [N] (Schiller and Naumann 1933).

    Cd = 24/Re (1 + 0.15 Re^0.687), good to Re = 800 and within a few percent to 1000.
    """
    speed = float(np.linalg.norm(velocity))
    if speed == 0:
        return np.zeros_like(velocity)
    reynolds = AIR_DENSITY * speed * diameter / AIR_VISCOSITY
    coefficient = 24 / reynolds * (1 + 0.15 * reynolds**0.687)
    return -0.5 * AIR_DENSITY * np.pi / 4 * diameter**2 * coefficient * speed * velocity


@dataclass(frozen=True)
class DropSetting:
    """One repetition."""

    diameter: float  # [m]
    mass: float  # [kg]
    height: float  # [m], lowest point of the bead above the plate at release
    release: float  # [s] after the start of frame 0
    restitution: float  # [1], at a contact speed of 1 m/s
    exponent: float  # [1], e = restitution * speed^-exponent: wood gives a little more the faster it hits
    kick: tuple[float, float] = (0.0, 0.0)  # [m/s], sideways velocity (x, y) gained in the first contact
    start: tuple[float, float] = (0.0, 0.0)  # [m], x and y of the bead in the holder


@dataclass(frozen=True)
class Bounce:
    """One contact with the plate and the flight after it."""

    time: float  # [s]
    speed_before: float  # [m/s], normal to the plate
    speed_after: float  # [m/s], normal to the plate
    apex_time: float  # [s]
    apex_height: float  # [m], lowest point of the bead above the plate

    @property
    def restitution(self) -> float:
        """Ratio of the normal speeds."""
        return self.speed_after / self.speed_before


@dataclass(frozen=True)
class DropMotion:
    """The whole motion; positions are of the bead's centre, x right, y away, z up from the plate."""

    setting: DropSetting
    bounces: tuple[Bounce, ...]
    pieces: tuple[tuple[float, float, Callable[[float], Floats]], ...]
    rest: tuple[float, Floats]

    def state(self, time: float) -> Floats:
        """x, y, z [m] and their velocities [m/s] at a time [s]."""
        if time <= self.setting.release:
            return np.array([*self.setting.start, self.setting.height + self.setting.diameter / 2, 0, 0, 0])
        for begin, end, solution in self.pieces:
            if begin <= time < end:
                return np.asarray(solution(time), dtype=float)
        return self.rest[1]


def fly(setting: DropSetting) -> DropMotion:
    """Integrate from release until the bead lies still."""
    radius = setting.diameter / 2

    def rate(time: float, state: Floats) -> Floats:
        acceleration = air_drag(state[3:], setting.diameter) / setting.mass
        acceleration[2] -= GRAVITY
        return np.concatenate([state[3:], acceleration])

    def touch(time: float, state: Floats) -> float:
        return float(state[2] - radius)

    def apex(time: float, state: Floats) -> float:
        return float(state[5])

    touch.terminal, touch.direction, apex.direction = True, -1, -1  # type: ignore[attr-defined]
    time = setting.release
    state = np.array([*setting.start, setting.height + radius, 0.0, 0.0, 0.0])
    pieces, bounces = [], []
    contact: tuple[float, float, float] | None = None
    while True:
        flight = solve_ivp(
            rate, (time, time + 2), state, events=(touch, apex), dense_output=True, rtol=1e-10, atol=1e-12
        )
        end = float(flight.t_events[0][0])
        pieces.append((time, end, flight.sol))
        if contact is not None:
            top = len(flight.t_events[1]) - 1
            bounces.append(Bounce(*contact, float(flight.t_events[1][top]), float(flight.y_events[1][top][2]) - radius))
        state = flight.y_events[0][0].copy()
        before = -float(state[5])
        after = before * setting.restitution * before**-setting.exponent
        if after < 0.012:  # hops under 0.01 mm: it lies still
            state[2:] = [radius, 0, 0, 0]
            return DropMotion(setting, tuple(bounces), tuple(pieces), (end, state))
        if contact is None:
            state[3:5] += setting.kick
        state[2], state[5] = radius, after
        time, contact = end, (end, before, after)
