"""How beads move in the labs with a hidden effect: equations of motion of the single-bead rigs, effects included.

Written apart from the simulator that is put to the test: free motion is integrated by DOP853 with dense output, an
impact is an instantaneous map, and nothing of `rigtwin.sim` or `rigtwin.compare` is used.  A motion is a `Path`, a
function of the true time; what the camera makes of it is in `labs_camera`.

An effect is one or more numbers in `World.hidden`; a number that is absent switches its term off.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

Array = npt.NDArray[np.float64]

GRAVITY = 9.81  # [m/s^2]
AIR_VISCOSITY = 1.8e-5  # [Pa s]
EPSILON_0 = 8.854e-12  # [F/m]
PRECISE = {"method": "DOP853", "rtol": 1e-10, "atol": 1e-12, "dense_output": True}
REST_SPEED = 0.012  # [m/s], rebounds slower than this are over
STOP_RATE = 3e-3  # [rad/s], width of the sign change of dry friction at a pivot


@dataclass(frozen=True)
class Bead:
    """A sphere as it really is."""

    name: str
    diameter: float  # [m]
    density: float  # [kg/m^3]
    material: str
    youngs_modulus: float  # [Pa]
    poisson_ratio: float

    @property
    def radius(self) -> float:
        return self.diameter / 2

    @property
    def mass(self) -> float:
        return self.density * math.pi / 6 * self.diameter**3

    @property
    def section(self) -> float:
        """Cross-section [m^2]"""
        return math.pi * self.radius**2


@dataclass
class World:
    """Everything that is true of one lab: the baseline's own numbers, their scatter, and what is hidden."""

    restitution: dict[str, float] = field(default_factory=dict)  # by "bead/wall" or "bead/bead"
    sliding: dict[str, float] = field(default_factory=dict)  # by wall
    rolling: dict[str, float] = field(default_factory=dict)  # by "bead/wall"
    restitution_scatter: float = 0.01  # per impact
    kick_scatter: float = 0.01  # [rad], direction of each rebound
    friction_scatter: float = 0.03  # relative, per run
    level: float = 0.0  # [rad], of the plate or the incline, inside what is stated
    hidden: dict[str, float] = field(default_factory=dict)


class Path:
    """A motion in pieces: rows of x, y per body [m] at any true time [s]."""

    def __init__(self) -> None:
        self.starts: list[float] = []
        self.pieces: list[Callable[[Array], Array]] = []
        self.end = 0.0

    def add(self, start: float, end: float, piece: Callable[[Array], Array]) -> None:
        """`piece` maps times, shape (k,), to positions, shape (bodies, 2, k)."""
        self.starts.append(start)
        self.pieces.append(piece)
        self.end = end

    def at(self, times: Array) -> Array:
        """Positions, shape (bodies, 2, k)."""
        flat = np.atleast_1d(times)
        which = np.maximum(np.searchsorted(self.starts, flat, side="right") - 1, 0)
        found = [(flat_rows := np.flatnonzero(which == k), self.pieces[k](flat[flat_rows])) for k in np.unique(which)]
        out = np.empty((*found[0][1].shape[:2], len(flat)))
        for rows, values in found:
            out[:, :, rows] = values
        return out


def still(*points: tuple[float, float]) -> Callable[[Array], Array]:
    """Bodies that stay where they are."""
    return lambda t: np.repeat(np.array(points)[:, :, None], len(t), axis=2)


# ------------------------------------------------------------------------------------------------ forces of the air


def air_force(bead: Bead, speed: float, hidden: Mapping[str, float]) -> float:
    """Resistance [N] of a bead at this speed."""
    force = 0.5 * hidden.get("kd", 0.0) * bead.section * speed**2
    if (multiplier := hidden.get("c_D", 0.0)) and speed > 0:
        reynolds = 1.2 * speed * bead.diameter / AIR_VISCOSITY
        coefficient = 24 / reynolds * (1 + 0.15 * reynolds**0.687) if reynolds < 1000 else 0.44
        force += multiplier * 0.5 * 1.2 * coefficient * bead.section * speed**2
    return force + hidden.get("linear_drag", 0.0) * bead.diameter * speed


def buoyant(bead: Bead, hidden: Mapping[str, float]) -> tuple[float, float]:
    """Share of the weight that is left, and the inertia with the fluid that goes along, relative to the mass."""
    ratio = hidden.get("fluid_density", 0.0) / bead.density
    return 1 - ratio, 1 + ratio / 2


# --------------------------------------------------------------------------------------------------------- impacts


@dataclass(frozen=True)
class Plate:
    """What a bead falls on."""

    density: float  # [kg/m^3]
    youngs_modulus: float  # [Pa]
    poisson_ratio: float
    thickness: float  # [m]


BLOCK = Plate(7850, 210e9, 0.3, 1.0)


def inelasticity(bead: Bead, plate: Plate, speed: float) -> float:
    """Zener's (1941) of a sphere on a wide plate that carries its bending waves away; ln e = -1.72 times that."""
    stiff = [one.youngs_modulus / (1 - one.poisson_ratio**2) for one in (bead, plate)]
    both = 1 / (1 / stiff[0] + 1 / stiff[1])
    waves = math.sqrt(plate.density * stiff[1])
    size = (bead.radius / plate.thickness) ** 2
    return math.pi**0.6 / math.sqrt(3) * size * bead.density**0.6 * both**0.4 * speed**0.2 / waves


def restitution_at(bead: Bead, base: float, speed: float, hidden: Mapping[str, float], plate: Plate) -> float:
    """Mean restitution of an impact at this normal speed [m/s]."""
    e = base
    if share := hidden.get("fvisc", 0.0):
        e = 1 - (1 - e) * ((1 - share) + share * speed**0.2)
    if exponent := hidden.get("e_exponent", 0.0):
        e *= speed**-exponent
    if (threshold := hidden.get("yield_speed", 0.0)) and speed > threshold:
        e *= (speed / threshold) ** -0.25
    if strength := hidden.get("plate_loss", 0.0):
        # the base is that on a block: what bends away comes on top
        e *= math.exp(-1.72 * strength * inelasticity(bead, plate, speed))
    if sticking := sticking_speed(bead, hidden):
        e = math.sqrt(max(e**2 - (sticking / speed) ** 2, 0.0))
    return min(max(e, 0.0), 0.99)


def sticking_speed(bead: Bead, hidden: Mapping[str, float]) -> float:
    """Speed [m/s] whose energy breaking the contact costs; `bond` is that energy per radius [J/m]."""
    return math.sqrt(2 * hidden.get("bond", 0.0) * bead.radius / bead.mass)


# ------------------------------------------------------------------------------------------------------------ drop


def drop(
    bead: Bead, wall: str, plate: Plate, height: float, world: World, rng: np.random.Generator, *, bounces: int = 4
) -> Path:
    """A bead released above a plate; origin on the plate, y up.  `height` [m] is that of its bottom."""
    hidden, path = world.hidden, Path()
    tilt = world.level + hidden.get("plate_tilt", 0.0)
    normal = np.array([-math.sin(tilt), math.cos(tilt)])
    along = np.array([math.cos(tilt), math.sin(tilt)])
    x, y = rng.normal(0, 8e-4), height + bead.radius
    begin = float(rng.uniform(0.01, 0.05))
    path.add(0.0, begin, still((x, y)))
    state = np.array([x, y, rng.normal(0, 0.004), 0.0])
    spin = hidden.get("release_spin", 0.0) * rng.normal(1, 0.1)
    pull = _flight(bead, hidden, spin_sign=math.copysign(1.0, spin) if spin else 1.0)

    def touch(_t: float, s: Array) -> float:
        return float(s[:2] @ normal - bead.radius)

    touch.terminal, touch.direction = True, -1  # type: ignore[attr-defined]
    base = world.restitution[f"{bead.name}/{wall}"]
    for bounce in range(bounces + 1):
        flight = solve_ivp(pull, (begin, begin + 3), state, events=touch, max_step=0.05, **PRECISE)
        end = float(flight.t[-1])
        if bounce == bounces:
            end = begin + (end - begin) * float(rng.uniform(0.2, 0.8))
        path.add(begin, end, lambda t, s=flight.sol: s(t)[None, :2])
        if bounce == bounces:
            break
        state, begin = flight.y[:, -1].copy(), end
        state, spin = _impact(bead, base, state, spin, (normal, along), wall, plate, world, rng)
        if state[2:] @ normal < REST_SPEED:
            path.add(begin, begin + float(rng.uniform(0.02, 0.1)), still((float(state[0]), float(state[1]))))
            break
    return path


def _flight(bead: Bead, hidden: Mapping[str, float], spin_sign: float) -> Callable[[float, Array], list[float]]:
    weight, inertia = buoyant(bead, hidden)
    charge = (hidden.get("charge", 0.0)) ** 2 / (16 * math.pi * EPSILON_0) / bead.mass
    drags = any(hidden.get(name) for name in ("kd", "c_D", "linear_drag"))
    magnet, reach = hidden.get("magnet", 0.0), hidden.get("magnet_reach", 0.03)
    lift, wind = hidden.get("lift", 0.0) * spin_sign, hidden.get("wind", 0.0)
    low, high = hidden.get("wind_low", 0.0), hidden.get("wind_high", 1e9)
    swirl = hidden.get("air_spring", 0.0)

    def motion(_t: float, s: Array) -> list[float]:
        x, y, vx, vy = s
        ax, ay = 0.0, -GRAVITY * weight
        if drags:
            speed = math.hypot(vx, vy)
            if speed > 0:
                brake = air_force(bead, speed, hidden) / bead.mass / speed
                ax, ay = ax - brake * vx, ay - brake * vy
        if charge:
            ay -= charge / max(y, 0.5 * bead.radius) ** 2
        if magnet:
            ay -= magnet * math.exp(-(y - bead.radius) / reach)
        if lift:
            ax, ay = ax - lift * vy, ay + lift * vx
        if wind and low < y < high:
            ax += wind
        if swirl:
            ax -= swirl * x * abs(vy)
        return [vx, vy, ax / inertia, ay / inertia]

    return motion


def _impact(
    bead: Bead, base: float, state: Array, spin: float, axes: tuple[Array, Array], wall: str, plate: Plate,
    world: World, rng: np.random.Generator,
) -> tuple[Array, float]:  # fmt: skip
    """Velocity and spin after a bounce: restitution along the normal, Coulomb friction up to rolling along it."""
    normal, along = axes
    hidden = world.hidden
    closing, slide = -float(state[2:] @ normal), float(state[2:] @ along)
    shape = hidden.get("odd_shape", 0.0)  # [rad], scatter of the true contact normal
    turned = rng.normal(0, shape) if shape else 0.0
    e = restitution_at(bead, base, closing, hidden, plate) + rng.normal(0, world.restitution_scatter)
    e *= math.cos(turned) ** 2 - 2 * turned**2
    e = min(max(e, 0.0), 0.99)
    friction = world.sliding[wall] * (1 + e) * closing
    slip = slide + spin * bead.radius
    grip = -math.copysign(min(friction, abs(slip) * 2 / 7), slip)
    slide, spin = slide + grip, spin + 2.5 * grip / bead.radius
    kick = rng.normal(0, world.kick_scatter) + (1 + e) * turned / max(e, 0.1)
    out = e * closing
    velocity = out * math.cos(kick) * normal + (slide + out * math.sin(kick)) * along
    after = state.copy()
    after[2:] = velocity
    after[:2] += normal * 1e-9  # off the plate, or the next flight ends where it starts
    return after, spin


# ------------------------------------------------------------------------------------------------------- pendulums


def swing_torque(bead: Bead, length: float, hidden: Mapping[str, float]) -> Callable[[float, float, float], float]:
    """Angular acceleration [rad/s^2] from the time [s], the angle from the vertical [rad] and its rate [rad/s]."""
    weight, added = buoyant(bead, hidden)
    thread = hidden.get("thread_density", 0.0) * length  # [kg]
    inertia = bead.mass * added * length**2 + thread * length**2 / 3
    restoring = (bead.mass * weight + thread / 2) * GRAVITY * length
    dry, viscous = hidden.get("tau_c", 0.0), hidden.get("c_pivot", 0.0)
    odd, hardening = hidden.get("odd_damping", 0.0), hidden.get("torsion_cubed", 0.0)
    draught, period = hidden.get("draught", 0.0), hidden.get("draught_period", 1.0)
    drags = any(hidden.get(name) for name in ("kd", "c_D", "linear_drag"))

    def acceleration(t: float, angle: float, rate: float) -> float:
        torque = -restoring * math.sin(angle)
        if drags and rate:
            torque -= math.copysign(air_force(bead, abs(rate) * length, hidden) * length, rate)
        if dry:
            torque -= dry * math.tanh(rate / STOP_RATE)
        torque -= viscous * rate
        result = torque / inertia
        if odd:
            result -= odd * angle**2 * rate
        if hardening:
            result -= hardening * angle**3
        if draught:
            result += draught * math.sin(2 * math.pi * t / period) / length
        return result

    return acceleration


def pendulum(
    bead: Bead, length: float, angle: float, duration: float, world: World, rng: np.random.Generator,
    *, wall: str | None = None,
) -> Path:  # fmt: skip
    """A bead on a thread, origin at the pivot, y up; with a wall it strikes a vertical plate at its lowest point."""
    path, hidden = Path(), world.hidden
    begin = float(rng.uniform(0.02, 0.08))
    pull = swing_torque(bead, length, hidden)
    path.add(0.0, begin, still((length * math.sin(angle), -length * math.cos(angle))))
    state = np.array([angle, 0.0])
    contact = world.level + hidden.get("plate_tilt", 0.0)  # [rad], the wall stands a little before or behind

    def strike(_t: float, s: Array) -> float:
        return float(s[0] - contact)

    strike.terminal, strike.direction = True, -1  # type: ignore[attr-defined]
    while begin < duration:
        swing = solve_ivp(
            lambda t, s: [s[1], pull(t, s[0], s[1])], (begin, duration), state,
            events=strike if wall else None, max_step=0.1, **PRECISE,
        )  # fmt: skip
        end = float(swing.t[-1])
        path.add(begin, end, lambda t, s=swing.sol: _on_circle(s(t)[0], length))
        if not wall or swing.status != 1:
            break
        closing = -float(swing.y[1, -1]) * length
        e = restitution_at(bead, world.restitution[f"{bead.name}/{wall}"], closing, hidden, BLOCK)
        e = min(max(e + rng.normal(0, world.restitution_scatter), 0.0), 0.99)
        if e * closing < REST_SPEED:
            duration = end  # what is left of the motion is too small to be followed: the record stops here
            break
        state, begin = np.array([contact + 1e-9, e * closing / length]), end
    path.end = duration
    return path


def _on_circle(angle: Array, length: float) -> Array:
    return np.array([[length * np.sin(angle), -length * np.cos(angle)]])


def double(
    bead: Bead, lengths: tuple[float, float], angle: float, duration: float, world: World, rng: np.random.Generator
) -> Path:
    """Two equal beads that hang side by side; A, on the left, is released from `angle` [rad] and strikes B.

    Origin midway between the pivots, which stand one diameter apart.
    """
    path, hidden = Path(), world.hidden
    begin = float(rng.uniform(0.02, 0.08))
    pulls = [swing_torque(bead, length, hidden) for length in lengths]
    pivots = (-bead.radius, bead.radius)
    # each hangs a little off: the beads rest against each other or a hair apart
    state = np.array([-angle, 0.0, abs(rng.normal(0, 2e-4)), 0.0])

    def places(a: Array, b: Array) -> Array:
        return np.array(
            [[pivots[k] + lengths[k] * np.sin(q), -lengths[k] * np.cos(q)] for k, q in enumerate((a, b))]
        )  # fmt: skip

    def distance(_t: float, s: Array) -> float:
        apart = places(s[0], s[2])
        between = apart[1] - apart[0]
        # a fast bead may be past the other within one step: it is then on its wrong side, not apart again
        return math.copysign(float(np.linalg.norm(between)), float(between[0])) - bead.diameter

    distance.terminal, distance.direction = True, -1  # type: ignore[attr-defined]
    path.add(0.0, begin, lambda t, s=tuple(state): places(np.full(len(t), s[0]), np.full(len(t), s[2])))

    def motion(t: float, s: Array) -> list[float]:
        hanging = s[3] == 0.0 and s[2] < 1e-3 and abs(s[2]) < 1e-3  # B waits, held by the least friction
        return [s[1], pulls[0](t, s[0], s[1]), s[3], 0.0 if hanging else pulls[1](t, s[2], s[3])]

    base = world.restitution[f"{bead.name}/{bead.name}"]
    for _ in range(60):
        swing = solve_ivp(motion, (begin, duration), state, events=distance, max_step=0.02, **PRECISE)
        end = float(swing.t[-1])
        path.add(begin, end, lambda t, s=swing.sol: places(s(t)[0], s(t)[2]))
        if swing.status != 1:
            break
        state, begin = _collide(bead, lengths, swing.y[:, -1].copy(), base, world, rng, places), end
        if abs(state[1] * lengths[0] - state[3] * lengths[1]) < 0.5 * REST_SPEED:
            break
    # the beads go on together once they no longer part; the record stops there
    path.end = min(duration, path.end)
    return path


def _collide(
    bead: Bead, lengths: tuple[float, float], state: Array, base: float, world: World, rng: np.random.Generator,
    places: Callable[[Array, Array], Array],
) -> Array:  # fmt: skip
    """Central impact of two equal beads, each free to move along its own circle."""
    here = places(state[0], state[2])
    normal = (here[1] - here[0]) / bead.diameter
    tangents = [np.array([math.cos(q), math.sin(q)]) for q in (state[0], state[2])]
    reach = [float(t @ normal) for t in tangents]
    speeds = [state[1] * lengths[0], state[3] * lengths[1]]
    closing = speeds[0] * reach[0] - speeds[1] * reach[1]
    e = restitution_at(bead, base, closing, world.hidden, BLOCK) + rng.normal(0, world.restitution_scatter)
    offset = world.hidden.get("off_centre", 0.0) * rng.normal(1, 0.15)  # of a diameter, out of the plane
    square = max(1 - offset**2, 0.0)
    e = min(max(e, 0.0), 0.99)
    impulse = (1 + e) * closing * square / (reach[0] ** 2 + reach[1] ** 2)
    after = state.copy()
    after[1] = (speeds[0] - impulse * reach[0]) / lengths[0]
    after[3] = (speeds[1] + impulse * reach[1]) / lengths[1]
    after[2] += 1e-9 / lengths[1]
    return after


# ----------------------------------------------------------------------------------------------------- tilting arm


def slide(
    mass: float, wall: str, *, start_angle: float, tilt_rate: float, place: float, height: float, stop: float,
    dwell: float, duration: float, world: World, rng: np.random.Generator,
) -> Path:  # fmt: skip
    """A clump of spheres on an arm that tilts at a steady rate; origin on the hinge, in the arm's surface.

    `start_angle` [rad] is the arm's at the first frame, `tilt_rate` [rad/s], `place` [m] the clump's first distance
    from the hinge, `height` [m] that of its centre above the arm.
    """
    path, hidden = Path(), world.hidden
    friction = world.sliding[wall] * (1 + rng.normal(0, world.friction_scatter))
    ageing = hidden.get("ageing", 0.0)
    extra = hidden.get("pull_off", 0.0) / mass  # adhesion [m/s^2]
    slippery, wave = hidden.get("viscous_sliding", 0.0), hidden.get("vibration", 0.0)

    def angle(t: Array | float) -> Array | float:
        return start_angle + world.level + tilt_rate * t

    def spot(r: Array, t: Array) -> Array:
        a = angle(t)
        return np.array([[r * np.cos(a) - height * np.sin(a), r * np.sin(a) + height * np.cos(a)]])

    def press(t: Array | float, rate: float) -> Any:
        shake = 1 - wave * np.sin(2 * math.pi * 3 * t) if wave else 1.0
        return GRAVITY * np.cos(angle(t)) * shake + extra + 2 * rate * tilt_rate - height * tilt_rate**2

    def rested(t: Array | float) -> Any:
        """Friction of contacts that have rested on the level arm and while it tilted."""
        return friction + ageing * np.log1p(dwell + t) if ageing else friction

    def surplus(t: Array | float) -> Array:
        """Pull along the arm beyond what friction holds [m/s^2]."""
        return GRAVITY * np.sin(angle(t)) - place * tilt_rate**2 - rested(t) * press(t, 0.0)

    waiting = np.arange(0.0, duration, 1e-3)
    holds = surplus(waiting) < 0
    if holds.all() or not holds[0]:
        raise ValueError("the clump must start to slide within the record")
    slips = int(np.argmin(holds))
    begin = float(brentq(surplus, waiting[slips - 1], waiting[slips], xtol=1e-12))
    path.add(0.0, begin, lambda t: spot(np.full(len(t), place), t))
    kinetic = rested(begin) * (1 - hidden.get("friction_drop", 0.0))

    def motion(t: float, s: Array) -> list[float]:
        drag = kinetic * press(t, s[1]) + slippery * abs(s[1])
        a = s[0] * tilt_rate**2 - GRAVITY * math.sin(angle(t)) + drag
        return [s[1], a if s[1] < 0 or a < 0 else 0.0]

    def arrive(_t: float, s: Array) -> float:
        return float(s[0] - stop)

    arrive.terminal, arrive.direction = True, -1  # type: ignore[attr-defined]
    run = solve_ivp(motion, (begin, duration), [place, -1e-9], events=arrive, max_step=0.02, **PRECISE)
    path.add(begin, float(run.t[-1]), lambda t: spot(run.sol(t)[0], t))
    return path


# --------------------------------------------------------------------------------------------------------- rolling


def roll(
    bead: Bead, wall: str, *, slope: float, push: float, distance: float, world: World, rng: np.random.Generator
) -> Path:
    """A sphere that rolls down an incline from rest, or over a level surface after a push.

    Origin where it touches at the start, x along the level, y up; `slope` [rad] downwards to the right, `push` [m/s],
    below zero to the left.
    """
    path, hidden = Path(), world.hidden
    side = -1.0 if push < 0 else 1.0
    fall = side * (slope + world.level + hidden.get("plate_tilt", 0.0))
    resistance = world.rolling[f"{bead.name}/{wall}"] * (1 + rng.normal(0, world.friction_scatter))
    if lever := hidden.get("lever_arm", 0.0):
        resistance = lever / bead.radius * (1 + rng.normal(0, world.friction_scatter))
    growth, sag = hidden.get("rolling_growth", 0.0), hidden.get("sag", 0.0)
    weight, added = buoyant(bead, hidden)
    stick = hidden.get("pull_off", 0.0) / bead.mass
    bump, pitch = hidden.get("ripple", 0.0), hidden.get("ripple_length", 0.2)
    begin = float(rng.uniform(0.01, 0.05))

    def spot(s: Array) -> Array:
        along, up = s * math.cos(fall) + bead.radius * math.sin(fall), bead.radius * math.cos(fall) - s * math.sin(fall)
        return np.array([[side * along, up]])

    def motion(_t: float, s: Array) -> list[float]:
        place, rate = s
        drive = GRAVITY * weight * math.sin(fall + sag * place)
        brake = (resistance + growth * abs(rate)) * (GRAVITY * weight * math.cos(fall) + stick)
        if rate > 0:
            brake += air_force(bead, rate, hidden) / bead.mass
        if bump:
            drive += bump * math.sin(2 * math.pi * place / pitch)
        return [rate, (drive - brake) / (0.4 + added)]

    def halt(_t: float, s: Array) -> float:
        return float(s[1])

    def leave(_t: float, s: Array) -> float:
        return float(s[0] - distance)

    halt.terminal, halt.direction = True, -1  # type: ignore[attr-defined]
    leave.terminal, leave.direction = True, 1  # type: ignore[attr-defined]
    path.add(0.0, begin, lambda t: spot(np.zeros(len(t))))
    speed = max(abs(push) * (1 + rng.normal(0, 0.05)), 1e-9) if push else 1e-9
    run = solve_ivp(motion, (begin, begin + 6), [0.0, speed], events=(halt, leave), max_step=0.05, **PRECISE)
    end = float(run.t[-1])
    path.add(begin, end, lambda t: spot(run.sol(t)[0]))
    if len(run.t_events[0]):
        rest = float(run.y[0, -1])
        path.add(end, end + 0.1, lambda t: spot(np.full(len(t), rest)))
    return path
