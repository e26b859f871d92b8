"""Two beads on threads: two damped pendulums between collisions, and an impulse at each collision."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_ivp

from rigtwin.sample_media.renderer.physics_drop import GRAVITY, Floats, air_drag


@dataclass(frozen=True)
class PendulumSetting:
    """One repetition.  Bead A hangs left and is released; bead B hangs at rest."""

    diameter: float  # [m]
    mass: float  # [kg], the same for both
    length: float  # [m], hinge to bead centre
    gap: float  # [m], between the beads when both hang still
    release_angle: float  # [rad], of bead A from the vertical, to the left
    release: float  # [s] after the start of frame 0
    restitution: float  # [1]
    pivot_damping: float  # [1/s], moment at the hinge per angular speed and moment of inertia

    @property
    def pivots(self) -> Floats:
        """Hinges of A and B, x and z [m], origin midway between them."""
        half = (self.diameter + self.gap) / 2
        return np.array([[-half, 0.0], [half, 0.0]])


@dataclass(frozen=True)
class Collision:
    """One contact of the two beads; speeds along the arcs, to the right positive."""

    time: float  # [s]
    before: tuple[float, float]  # [m/s], A and B
    after: tuple[float, float]  # [m/s], A and B

    @property
    def restitution(self) -> float:
        """Speed of parting over speed of approach."""
        return (self.after[1] - self.after[0]) / (self.before[0] - self.before[1])


@dataclass(frozen=True)
class PendulumMotion:
    """The whole motion as angles from the vertical, to the right positive."""

    setting: PendulumSetting
    collisions: tuple[Collision, ...]
    pieces: tuple[tuple[float, float, Callable[[float], Floats]], ...]

    def angles(self, time: float) -> Floats:
        """Angles of A and B [rad] and their rates [rad/s], shape (4,)."""
        if time <= self.setting.release:
            return np.array([-self.setting.release_angle, 0, 0, 0])
        for begin, end, solution in self.pieces:
            if begin <= time < end:
                return np.asarray(solution(time), dtype=float)
        raise ValueError(f"the motion was not computed to {time} s")

    def centres(self, time: float) -> Floats:
        """Bead centres of A and B, x and z [m], shape (2, 2)."""
        theta = self.angles(time)[:2]
        return self.setting.pivots + self.setting.length * np.column_stack([np.sin(theta), -np.cos(theta)])


def swing(setting: PendulumSetting, until: float) -> PendulumMotion:
    """Integrate from release to `until` [s]."""

    def rate(time: float, state: Floats) -> Floats:
        theta, omega = state[:2], state[2:]
        speed = setting.length * omega
        drag = np.array([air_drag(speed[k : k + 1], setting.diameter)[0] for k in (0, 1)])
        turn = (
            -GRAVITY / setting.length * np.sin(theta)
            - setting.pivot_damping * omega
            + drag / (setting.mass * setting.length)
        )
        return np.concatenate([omega, turn])

    def apart(time: float, state: Floats) -> float:
        theta = state[:2]
        centres = setting.pivots + setting.length * np.column_stack([np.sin(theta), -np.cos(theta)])
        return float(np.linalg.norm(centres[1] - centres[0]) - setting.diameter)

    apart.terminal, apart.direction = True, -1  # type: ignore[attr-defined]
    time, state = setting.release, np.array([-setting.release_angle, 0.0, 0.0, 0.0])
    pieces, collisions = [], []
    while time < until:
        flight = solve_ivp(
            rate, (time, until + 1e-3), state, events=apart, dense_output=True, rtol=1e-10, atol=1e-12, max_step=0.01
        )
        end = float(flight.t[-1])
        pieces.append((time, end, flight.sol))
        if not len(flight.t_events[0]):
            break
        state = flight.y[:, -1].copy()
        a, b = setting.length * state[2], setting.length * state[3]
        # equal masses: momentum kept, speed of parting e times the speed of approach
        mean, half = (a + b) / 2, (a - b) / 2 * setting.restitution
        collisions.append(Collision(end, (float(a), float(b)), (float(mean - half), float(mean + half))))
        state[2:] = np.array([mean - half, mean + half]) / setting.length
        time = end
    return PendulumMotion(setting, tuple(collisions), tuple(pieces))


def turning_angle(motion: PendulumMotion, body: int, after: float, until: float) -> float:
    """Largest deflection of a bead [rad] between two times."""
    times = np.linspace(after, until, 4001)
    return float(max(abs(motion.angles(t)[body]) for t in times))
