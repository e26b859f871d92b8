"""The linear contact law against the damped harmonic oscillator that lets go where its force is zero."""

from __future__ import annotations

import math

import numpy as np
from scipy.optimize import brentq

from rigtwin.benchmarks.figures import Row, against
from rigtwin.lab.materials import Contact, Material, Particle
from rigtwin.sim.engine.few.few_body import Body, run
from rigtwin.sim.engine.walls.shapes import Plane, Wall

ASH = Material("ash", 720, 11e9, 0.44)
D6 = Particle("D6", ASH, 6e-3, density=569)
FLOOR = Plane((0, 0, 0), (0, 0, 1))
WEIGHTLESS = (0.0, 0.0, 0.0)
SPEEDS = (0.05, 0.5, 5.0)
STEPS = 2000  # of an undamped contact


def linear() -> list[Row]:
    """Restitution, duration and depth of impacts on a wall."""
    rows = []
    for e in (0.1, 0.3, 0.5, 0.75, 0.9, 1.0):
        found = [_impact(e, speed) for speed in SPEEDS]
        worst = max((back for back, _, _ in found), key=lambda value: abs(value - e))
        rows.append(against(f"linear, restitution {e}", worst, e, relative=3e-3, note="worst of 0.05 to 5 m/s"))
        expected = _duration(e) / math.sqrt(_stiffness() / D6.mass)
        last = max((lasts for _, lasts, _ in found), key=lambda value: abs(value - expected))
        rows.append(
            against(
                f"linear, restitution {e}: time", last * 1e6, expected * 1e6, relative=5e-3, unit="us", note="worst"
            )
        )
    for speed, (_, _, depth) in zip(SPEEDS, found, strict=True):
        expected = speed * math.sqrt(D6.mass / _stiffness()) * 1e6
        name = f"linear, elastic at {speed} m/s: greatest overlap"
        rows.append(against(name, depth * 1e6, expected, relative=1e-3, unit="um"))
    return rows


def _stiffness(speed: float = 1.0) -> float:
    """The spring that stops the bead, at this speed, where Hertz's contact with a wall of its material does [N/m]."""
    modulus = ASH.youngs_modulus / 2 / (1 - ASH.poisson_ratio**2)
    depth = (15 / 16 * D6.mass * speed**2 / (modulus * math.sqrt(D6.radius))) ** (2 / 5)
    return D6.mass * speed**2 / depth**2


def _duration(e: float) -> float:
    """Of a contact that returns `e`, in units of 1/omega.

    (pi - 2a)/cos(a) where e = exp(-(pi - 2a) tan(a)); overdamped, 2b/sinh(b) where e = exp(-2b coth(b)).
    """
    loss = -math.log(e)
    if loss < 2:
        a = brentq(lambda a: (math.pi - 2 * a) * math.tan(a) - loss, 0, math.pi / 2 - 1e-9)
        return float((math.pi - 2 * a) / math.cos(a))
    b = brentq(lambda b: 2 * b / math.tanh(b) - loss, 1e-6, loss)
    return float(2 * b / math.sinh(b))


def _impact(e: float, speed: float) -> tuple[float, float, float]:
    """Restitution, time until the speed changes no more [s], and greatest overlap [m]."""
    step = math.pi / math.sqrt(_stiffness() / D6.mass) / STEPS
    body = Body(D6, (0, 0, D6.radius), velocity=(0, 0, -speed))
    walls = [Wall(FLOOR, ASH, Contact(e, 0.0))]
    times = np.linspace(step, 2.5 * STEPS * step, 2500)
    motion = run(
        [body], times, walls=walls, gravity=WEIGHTLESS, step=step, flight_step=step, contact_law="linear"
    )  # fmt: skip
    rise = motion.velocity[:, 0, 2]
    changing = times[:-1][np.abs(np.diff(rise)) > 1e-9 * speed]
    overlap = D6.radius - motion.position[:, 0, 2]
    return float(rise[-1] / speed), float(changing.max()), float(overlap.max())
