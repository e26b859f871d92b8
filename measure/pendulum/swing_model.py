"""Motion of one or two beads on threads: geometry, gravity, damping, and every collision.

Each bead is a damped pendulum on its own circle,

    theta'' = -(g / L) sin(theta) - c theta' - k |theta'| theta'
    x = X + L sin(theta),  y = Y - L cos(theta)                       (y against gravity)

whose angular speed jumps at a collision while its angle is continuous.  `rigtwin.measure.pendulum.swing_fit` fits it
to tracks.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from rigtwin.lab.arrays import Array
from rigtwin.lab.integration import hermite, hermite_slope, runge_kutta

STEP = 0.008  # [s], step of the Runge-Kutta integration: error below 3e-6 rad over a swing of a 100 mm pendulum
MOST_STEPS = 20_000  # of one swing: 160 s

_SHARED = (
    "tilt",
    "gravity",
    "damping",
    "drag",
    "perspective_x",
    "perspective_y",
    "lens",
    "release_angle",
    "release_time",
)


@dataclass(frozen=True)
class Swings:
    """Parameters of the motion of `beads` beads through their collisions, in the record's own units.

    `vector` may be a batch, shape (n_parameters, batch): every property then has the batch as its last axis.
    """

    vector: Array
    beads: int
    collisions: int
    axis: tuple[float, float] | None = None  # principal point in the record's axes; None: half-way down the thread

    @staticmethod
    def names(beads: int, collisions: int) -> list[str]:
        """Names of the entries of `vector`, in order."""
        of_beads = [f"{name}_{bead}" for bead in range(beads) for name in ("pivot_x", "pivot_y", "length")]
        of_collisions = [
            name for k in range(collisions) for name in (f"time_{k}", *(f"speed_{k}_{bead}" for bead in range(beads)))
        ]
        return [*of_beads, *_SHARED, *of_collisions]

    def index(self, name: str) -> int:
        return self.names(self.beads, self.collisions).index(name)

    def __getitem__(self, name: str) -> Array:
        return np.asarray(self.vector[self.index(name)])

    def per_bead(self, name: str) -> Array:
        """One entry per bead, shape (beads, ...)."""
        return np.stack([self[f"{name}_{bead}"] for bead in range(self.beads)])

    def after(self, collision: int) -> Array:
        """Angular speeds [rad/s] just after a collision, shape (beads, ...)."""
        return np.stack([self[f"speed_{collision}_{bead}"] for bead in range(self.beads)])

    def batch(self, columns: Array) -> Swings:
        """The same model with other parameters, one set per column, shape (n_parameters, batch)."""
        return replace(self, vector=columns)

    def batched(self) -> Swings:
        """The same as a batch (of size 1 for a single vector)."""
        return self.batch(self.vector.reshape(len(self.vector), -1))


def angles(swings: Swings, time: Array) -> tuple[Array, Array]:
    """Angles [rad] from gravity's direction and angular speeds [rad/s] at `time`, shape (beads, n, batch)."""
    swings = swings.batched()
    batch = swings.vector.shape[1]
    angle = np.zeros((swings.beads, len(time), batch))
    speed = np.zeros_like(angle)
    state, start = np.zeros((swings.beads, batch)), swings["release_time"]
    state[0] = swings["release_angle"]
    rate = np.zeros_like(state)
    angle[0], last = state[0], float(np.max(time)) + STEP
    # an optimizer may try collisions long after the record
    ends = [np.minimum(swings[f"time_{k}"], last) for k in range(swings.collisions)]
    for k, end in enumerate([*ends, np.full(batch, last)]):
        if k > 0:
            rate = swings.after(k - 1)
        inside = (time[:, None] >= start) & (time[:, None] < end)
        inside_angle, inside_speed, state, rate = _integrate(swings, state, rate, start, end, time=time)
        angle, speed = np.where(inside, inside_angle, angle), np.where(inside, inside_speed, speed)
        start = end
    return angle, speed


def centres(swings: Swings, angle: Array) -> Array:
    """Positions of the beads in the record's axes, shape (beads, n, batch, 2)."""
    swings = swings.batched()
    pivot = np.stack([swings.per_bead("pivot_x"), swings.per_bead("pivot_y")], axis=-1)[:, None]
    length = swings.per_bead("length")[:, None]
    turned = angle + swings["tilt"]
    with np.errstate(invalid="ignore"):  # a diverging swing has no position
        return np.stack([pivot[..., 0] + length * np.sin(turned), pivot[..., 1] - length * np.cos(turned)], axis=-1)


def positions(swings: Swings, angle: Array) -> Array:
    """Apparent positions of the beads, shape (beads, n, batch, 2): `centres` with perspective and lens distortion."""
    return _apparent(swings.batched(), centres(swings, angle))


def pivots(swings: Swings) -> Array:
    """Apparent positions of the pivots, shape (beads, 1, batch, 2)."""
    swings = swings.batched()
    places = np.stack([swings.per_bead("pivot_x"), swings.per_bead("pivot_y")], axis=-1)
    return _apparent(swings, places[:, None])


def _apparent(swings: Swings, places: Array) -> Array:
    """Places in the plane of the swing as the camera sees them, shape (beads, n, batch, 2)."""
    unit = swings["length_0"]
    # relative to the principal point, in units of the pendulum length
    if swings.axis is None:
        middle = np.stack([swings["pivot_x_0"], swings["pivot_y_0"] - 0.5 * unit], axis=-1)
    else:
        middle = np.broadcast_to(np.array(swings.axis), (len(unit), 2))
    away = (places - middle) / unit[..., None]
    u, v = away[..., 0], away[..., 1]
    nearer = swings["perspective_x"] * u + swings["perspective_y"] * v
    growth = nearer / (1 - nearer) + swings["lens"] * (u * u + v * v)
    return np.asarray(middle + (1 + growth[..., None]) * away * unit[..., None])


def states_at_collision(swings: Swings, collision: int) -> tuple[Array, Array]:
    """Angles [rad] at a collision and angular speeds [rad/s] just before it, shape (beads, batch)."""
    swings = swings.batched()
    state, start = np.zeros((swings.beads, swings.vector.shape[1])), swings["release_time"]
    state[0] = swings["release_angle"]
    rate = np.zeros_like(state)
    for k in range(collision + 1):
        if k > 0:
            rate = swings.after(k - 1)
        end = swings[f"time_{k}"]
        _, _, state, rate = _integrate(swings, state, rate, start, end, time=np.zeros(0))
        start = end
    return state, rate


def turning_points(swings: Swings, collision: int) -> tuple[Array, Array]:
    """Angle [rad] at which each bead turns after a collision, and the time [s] of it; shape (beads, batch)."""
    swings = swings.batched()
    state, _ = states_at_collision(swings, collision)
    start = swings[f"time_{collision}"]
    period = 2 * math.pi * np.sqrt(np.max(swings.per_bead("length"), axis=0) / swings["gravity"])
    grid = np.linspace(0, 0.7 * float(np.max(period)), 400)
    rate = swings.after(collision)
    angle, speed, _, _ = _integrate(swings, state, rate, 0 * start, 0 * start + grid[-1], time=grid)
    turned = np.sign(speed) != np.sign(rate[:, None])
    turned[:, 0] = False
    k = np.argmax(turned, axis=1)[:, None]
    before, after = np.take_along_axis(speed, k - 1, 1), np.take_along_axis(speed, k, 1)
    fraction = before / np.where(before == after, 1, before - after)
    step = grid[1]
    # between two grid points the speed falls linearly to zero: the angle still gains the triangle under it
    turning = np.take_along_axis(angle, k - 1, 1) + 0.5 * before * fraction * step
    return turning[:, 0], start + (grid[k[:, 0] - 1] + fraction[:, 0] * step)


@np.errstate(over="ignore", invalid="ignore")  # an optimizer may try diverging parameters
def _integrate(
    swings: Swings, angle: Array, rate: Array, start: Array, end: Array, *, time: Array
) -> tuple[Array, Array, Array, Array]:
    """Integrate a free swing from `start` to `end`, shape (batch,); angles and speeds at `time`, then at `end`."""
    pull = swings["gravity"] / swings.per_bead("length")
    damping, drag = swings["damping"], swings["drag"]

    def turn(theta: Array, omega: Array) -> Array:
        return np.asarray(-pull * np.sin(theta) - (damping + drag * np.abs(omega)) * omega)

    # an optimizer may try a release long before the record: a swing that lasts too long has no position
    lasts = np.where(end - start <= MOST_STEPS * STEP, end - start, np.nan)
    steps = max(2, math.ceil(float(np.nanmax(lasts, initial=0.0)) / STEP))
    h = lasts / steps
    angles_, rates = np.empty((steps + 1, *angle.shape)), np.empty((steps + 1, *angle.shape))
    angles_[0], rates[0] = angle, rate
    for i in range(steps):
        angles_[i + 1], rates[i + 1] = runge_kutta(turn, angles_[i], rates[i], h)
    at_time, speed_at_time = _between(angles_, rates, (time[:, None] - start) / np.where(h == 0, 1, h), h)
    return at_time, speed_at_time, angles_[-1], rates[-1]


def _between(angle: Array, rate: Array, place: Array, h: Array) -> tuple[Array, Array]:
    """Cubic Hermite interpolation at `place` (in steps, shape (n, batch)); shape (beads, n, batch)."""
    k = np.clip(np.nan_to_num(np.floor(place)), 0, len(angle) - 2).astype(np.int64)
    s = np.clip(place - k, 0, 1)
    columns = np.arange(angle.shape[2])
    a0, a1, w0, w1 = (np.moveaxis(table[k + ahead, :, columns], 2, 0) for table in (angle, rate) for ahead in (0, 1))
    step = a0, a1, h * w0, h * w1
    return hermite(*step, s), hermite_slope(*step, s) / np.where(h == 0, 1, h)
