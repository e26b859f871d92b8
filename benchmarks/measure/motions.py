"""What beads do before a camera: falls through air with bounces, swings with collisions, and what a lens does."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy.integrate import cumulative_trapezoid, solve_ivp

from rigtwin.lab.rigs import GRAVITY

Array = npt.NDArray[np.float64]

BEAD, STEEL = 6e-3, 7800.0  # [m], [kg/m^3]
AIR_DENSITY, AIR_VISCOSITY = 1.2, 1.81e-5  # [kg/m^3], [Pa s]


def through_a_camera(places: Array, rng: np.random.Generator) -> Array:
    """Places [m] as seen by a camera whose axis stands some 1.5 degrees off the normal, through a lens that barrels."""
    middle, unit = np.mean(places, axis=0), float(np.ptp(places, axis=0).max())
    away = (places - middle) / unit
    growth = away @ rng.normal(0, 0.0065, 2) + rng.normal(0, 0.003) * np.sum(away**2, axis=1)
    return np.asarray(middle + (1 + growth[:, None]) * away * unit)


def bounces(
    times: Array, height: float, restitution: float, release: float, *, drag: float, dwell: float
) -> tuple[Array, list[float]]:
    """Heights [m] of a steel bead of 6 mm at `times` [s], falling through air flight by flight; and its apexes [m].

    `drag` multiplies that of a smooth sphere; contacts last `dwell` [s].
    """
    state, begun, heights = np.array([height, 0.0]), release, np.full(len(times), height)
    apexes = []
    while begun < times[-1] and (begun == release or state[1] > 0.05):
        asked = times > begun
        flight = solve_ivp(
            _through_air,
            (begun, times[-1] + 1.0),
            state,
            events=(_touch, _turn),
            t_eval=times[asked],
            args=(drag,),
            rtol=1e-10,
            atol=1e-12,
        )
        apexes += [height] if begun == release else [float(turned[0]) for turned in flight.y_events[1]]
        heights[asked] = 0.0
        heights[np.flatnonzero(asked)[: flight.y.shape[1]]] = flight.y[0]
        if not len(flight.t_events[0]):
            break
        begun, state = float(flight.t_events[0][0]) + dwell, np.array([0.0, -restitution * flight.y_events[0][0][1]])
    return heights, apexes


def _through_air(_: float, state: Array, drag: float) -> tuple[float, float]:
    """Gravity and the drag of Schiller and Naumann (1933) on a sphere."""
    speed = abs(state[1])
    reynolds = max(AIR_DENSITY * speed * BEAD / AIR_VISCOSITY, 1e-9)
    coefficient = drag * 24 / reynolds * (1 + 0.15 * reynolds**0.687)
    return state[1], -GRAVITY - 0.75 * coefficient * AIR_DENSITY / STEEL * speed * state[1] / BEAD


def _touch(_: float, state: Array, __: float) -> float:
    return float(state[0]) if state[1] < 0 else 1.0


def _turn(_: float, state: Array, __: float) -> float:
    return float(state[1])


_touch.terminal = True  # type: ignore[attr-defined]


def swing(
    times: Array, length: float, release: float, e: float, *, begun: float, damping: float = 0.0, drag: float = 0.0
) -> Array:
    """Angles [rad] of two equal beads at `times` [s], by small symplectic steps, shape (n, 2).

    The one is let go of at `begun` [s]; `damping` [1/s] of hinge and thread, `drag` [1/rad] of the air.
    """
    step, seen = 2e-4, []
    angle, speed, now = np.array([-release, 0.0]), np.zeros(2), begun
    for moment in times:
        while now < moment:
            h = min(step, moment - now)
            closing = speed[0] - speed[1]
            gap = angle[1] - angle[0]
            if closing > 0 and gap < h * closing:  # the step ends at the contact
                h = max(gap / closing, 0.0)
            half = angle + h / 2 * speed
            speed = speed - h * (GRAVITY / length * np.sin(half) + (damping + drag * np.abs(speed)) * speed)
            angle, now = half + h / 2 * speed, now + h
            if closing > 0 and gap <= h * closing * (1 + 1e-9):
                total, closing = speed.sum(), speed[0] - speed[1]
                speed = np.array([total - e * closing, total + e * closing]) / 2
        seen.append(angle.copy())
    return np.array(seen)


def run_down(times: Array, turn: Array, onset: float, kept: float, factor: float) -> Array:
    """Way [m] down a plate that stands at the angles `turn` [rad] at finely spaced `times` [s], from the onset [s] on.

    `kept` is the share of the friction at the onset that a moving body meets, `factor` the inertia: 1 sliding, 5/7
    rolling.
    """
    friction = kept * np.tan(np.interp(onset, times, turn))
    push = np.where(times > onset, factor * GRAVITY * (np.sin(turn) - friction * np.cos(turn)), 0.0)
    speed = cumulative_trapezoid(push, times, initial=0)
    return np.asarray(cumulative_trapezoid(speed, times, initial=0))
