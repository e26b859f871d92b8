"""Effects in the equations of motion: the functions of the effect files, compiled into the time step.

The same functions are used by the reduced models, so the two cannot disagree.  The set of active effects is fixed when
the step is compiled; without effects the compiled step is unchanged.  The parameters are data.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from types import FunctionType
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from rigtwin.lab.arrays import Array
from rigtwin.lab.errors import BadInput
from rigtwin.sim.effects import Effect, named
from rigtwin.sim.engine.backend import ti

if TYPE_CHECKING:
    from rigtwin.lab.file.model_file import Effects
    from rigtwin.lab.materials import Particle


HALF = 0.5

DAMPING_FACTOR = 2 * math.sqrt(5 / 6)  # from a damping ratio to the law's column DAMPING

# hooks that the engine evaluates, and their number of arguments before the parameters
HOOKS = {"force": 5, "torque": 4, "restitution": 4, "attraction": 3, "neck": 2}


@dataclass(frozen=True)
class Active:
    """An effect with the values of its parameters, in SI units and in their order."""

    effect: Effect
    values: tuple[float, ...]


def active(effect: str | Effect, /, **parameters: float) -> Active:
    """Effect with parameter values; default: the predicted value if there is one, else the typical value.

    >>> active("air_drag").values
    (0.44,)
    """
    effect = named(effect) if isinstance(effect, str) else effect
    known = {parameter.name: parameter for parameter in effect.parameters}
    for name, value in parameters.items():
        if name not in known:
            raise BadInput(f"effect {effect.name}: there is no parameter {name!r}; it has {', '.join(known)}.")
        if not known[name].low <= value <= known[name].high:
            raise BadInput(
                f"effect {effect.name}: {name} = {value:g} {known[name].unit} lies outside "
                f"{known[name].low:g} to {known[name].high:g}."
            )
    values = []
    for name, parameter in known.items():
        assumed = parameter.typical if parameter.assumed is None else parameter.assumed[0]
        usual = assumed if parameter.predicted is None else parameter.predicted
        values.append(float(parameters.get(name, usual)))
    return Active(effect, tuple(values))


def acting(effects: Effects, *, pivots: bool = False) -> tuple[Active, ...]:
    """Effects of a model that act on the motion of bodies; pivot torques only with `pivots`.

    Effects of the camera or of the geometry of the rig are left out.
    """
    found = [active(name, **values) for name, values in effects.items()]
    hooks = [hook for hook in HOOKS if pivots or hook != "torque"]
    return tuple(
        one
        for one in found
        if one.effect.kind == "physical" and any(getattr(one.effect, hook) is not None for hook in hooks)
    )


def acting_among(effects: Effects, particle: Particle) -> tuple[tuple[Active, ...], tuple[str, ...]]:
    """Effects of a model that the bulk engine simulates for such particles, and a warning about the others."""
    clumps = particle.shape is not None
    active = tuple(one for one in acting(effects) if not (clumps and one.effect.force is not None))
    forces = ", and forces in flight on single spheres only" if clumps else ""
    why = f"the bulk engine simulates only effects on contacts and forces by motion and height{forces}"
    return active, left_out(effects, active, why)


def acting_on_few(effects: Effects, *, pivots: bool = False) -> tuple[tuple[Active, ...], tuple[str, ...]]:
    """Effects that act on few bodies, pivot torques only with `pivots`, and a warning about the others."""
    active = acting(effects, pivots=pivots)
    why = (
        "simulations of few bodies include only forces by motion and height, attraction, restitution and, in a "
        "pendulum, pivot torques"
    )
    return active, left_out(effects, active, why)


def named_in(active: Sequence[Active]) -> dict[str, str]:
    """The active effects by name, for the settings of a result; nothing if there are none."""
    return {"effects": ", ".join(one.effect.name.replace("_", " ") for one in active)} if active else {}


def left_out(effects: Effects, active: Sequence[Active], why: str) -> tuple[str, ...]:
    """Warning about the effects that are not active; empty if there are none."""
    names = [name for name in effects if name not in {one.effect.name for one in active}]
    return (f"the model's {', '.join(names)} had no part in this run: {why}",) if names else ()


def adhesion_of(effects: Sequence[Active]) -> Adhesion | None:
    """Sum of the effects' attractions, and the longest of their necks; None without attraction."""
    pulls = [(one.effect.attraction, one.values) for one in effects if one.effect.attraction is not None]
    necks = [(one.effect.neck, one.values) for one in effects if one.effect.neck is not None]
    if not pulls:
        return None

    def reach(radius: Any, modulus: Any) -> Any:
        return np.max([0.0 * radius, *(neck(radius, modulus, *values) for neck, values in necks)], axis=0)

    return Adhesion(
        lambda overlap, radius, modulus: sum(pull(overlap, radius, modulus, *values) for pull, values in pulls), reach
    )


def terms_of(effects: Sequence[Active], place: str) -> Terms:
    """Compiled terms of these effects with their parameters; each engine (`place`) has its own."""
    terms = terms_among(tuple(one.effect for one in checked(effects)), place)
    terms.load([effects])
    return terms


def checked(effects: Sequence[Active]) -> Sequence[Active]:
    """Return the effects; raise `BadInput` if the engine cannot evaluate one of them."""
    for one in effects:
        if not any(getattr(one.effect, hook, None) for hook in HOOKS):
            raise BadInput(
                f"effect {one.effect.name}: it has no force, torque, restitution or attraction that the engine could "
                "simulate; it acts in the rig or the camera only."
            )
        for hook, own in HOOKS.items():
            function = getattr(one.effect, hook, None)
            takes = own + len(one.values)
            if isinstance(function, FunctionType) and function.__code__.co_argcount != takes:
                raise BadInput(
                    f"effect {one.effect.name}: its {hook} takes {function.__code__.co_argcount} numbers and must take "
                    f"{takes}: {own} of the motion and {len(one.values)} parameters."
                )
    return effects


@cache
def terms_among(effects: tuple[Effect, ...], place: str, copies: int = 1) -> Terms:
    """Compiled terms of these effects for up to `copies` copies, each with its own parameters."""
    return Terms(effects, copies)


def _compiled(function: Callable[..., Any]) -> Any:
    """The function as a Taichi function; without annotations, which Taichi would interpret in its own way."""
    if not isinstance(function, FunctionType):
        raise BadInput(f"{function!r}: a hook of an effect must be a plain Python function.")
    around = dict(function.__globals__)
    for name in function.__code__.co_names:  # functions that it calls from its own file
        if isinstance(around.get(name), FunctionType):
            around[name] = _compiled(around[name])
    bare = FunctionType(function.__code__, around, function.__name__, function.__defaults__, function.__closure__)
    return ti.func(bare)


@ti.func
def towards_x(up):
    """Horizontal unit vector on the side of positive x."""
    return (ti.Vector([1.0, 0.0, 0.0]) - up[0] * up).normalized(1e-30)


@ti.data_oriented
class Terms:
    """Sums over the active effects, one function for each place where an effect can enter.

    The lists are known at compile time; a place where no effect enters compiles to nothing.  Parallel copies of a
    simulation have their own parameters.
    """

    def __init__(self, effects: tuple[Effect, ...], copies: int = 1) -> None:
        self.effects = effects
        self.copies = copies
        self.rows: Mapping[str, list[tuple[int, int, Any]]] = {
            hook: [
                (row, len(effect.parameters), _compiled(function))
                for row, effect in enumerate(effects)
                if (function := getattr(effect, hook, None)) is not None
            ]
            for hook in HOOKS
        }
        self.forces, self.torques = self.rows["force"], self.rows["torque"]
        self.restitutions, self.attractions = self.rows["restitution"], self.rows["attraction"]
        self.necks = self.rows["neck"]
        self.acts_in_flight = bool(self.forces)
        self.acts_on_threads = bool(self.torques)
        self.changes_restitution = bool(self.restitutions)
        self.attracts = bool(self.attractions)
        self.has_neck = bool(self.necks)
        self.act_on_bodies = self.acts_in_flight or self.acts_on_threads
        self.act_on_contacts = self.changes_restitution or self.attracts
        self.most = max([1, *(len(effect.parameters) for effect in effects)])
        self.values: Any = ti.field(ti.f64, (copies, len(effects), self.most)) if effects else None

    def load(self, effects: Sequence[Sequence[Active]]) -> None:
        """Set the parameters, one list of the effects per copy."""
        if self.values is None:
            return
        values = np.zeros((self.copies, len(self.effects), self.most))
        for copy, its in enumerate(effects):
            for row, one in enumerate(its):
                values[copy, row, : len(one.values)] = one.values
        self.values.from_numpy(values)

    @ti.func
    def in_flight(self, velocity, gap, radius, mass, up, copy=0):
        """Force [N] on a sphere that moves at `velocity`, `gap` [m] above the nearest wall; `up` is a unit vector.

        Effects are written for motion in a plane: that of `up` and the velocity, or, for effects with a fixed
        direction, that of `up` and x.
        """
        rise = velocity.dot(up)
        level = velocity - rise * up
        ahead = level / ti.max(level.norm(), 1e-30)
        total = ti.Vector([0.0, 0.0, 0.0])
        for k in ti.static(range(len(self.forces))):
            row, count, function = ti.static(self.forces[k])
            along = ahead
            if ti.static(self.effects[row].aimed):
                along = towards_x(up)
            sideways, upwards = function(
                level.dot(along), rise, gap, radius, mass, *[self.values[copy, row, p] for p in ti.static(range(count))]
            )
            total += sideways * along + upwards * up
        return total

    @ti.func
    def on_thread(self, velocity, arm, length, mass, up, copy=0):
        """Force [N] on a sphere suspended from a pivot at -`arm` (unit vector), from torques about the pivot."""
        across = velocity - velocity.dot(up) * up
        total = ti.Vector([0.0, 0.0, 0.0])
        for k in ti.static(range(len(self.torques))):
            row, count, function = ti.static(self.torques[k])
            # the angle is counted in the direction of motion; at a turning point there is no direction, and no friction
            side, speed = across / ti.max(across.norm(), 1e-30), velocity.norm()
            way = velocity / ti.max(speed, 1e-30)
            if ti.static(self.effects[row].aimed):
                side = towards_x(up)
                way = (arm.dot(side) * up - arm.dot(up) * side).normalized(1e-30)
                speed = velocity.dot(way)
            angle = ti.atan2(arm.dot(side), -arm.dot(up))
            its = function(
                angle, speed / length, length, mass, *[self.values[copy, row, p] for p in ti.static(range(count))]
            )
            total += its / length * way
        return total

    @ti.func
    def damping_of_pair(self, damping, closing, radius_eff, mass_eff, copy=0):
        """As `damping`, with effective values; of equal beads it uses their own radius and mass."""
        return self.damping(damping, closing, 2.0 * radius_eff, 2.0 * mass_eff, copy)

    @ti.func
    def damping(self, damping, closing, radius, mass, copy=0):
        """Column DAMPING for an impact at the speed `closing`; the value of the law is that at 1 m/s."""
        e = restitution_of(damping / DAMPING_FACTOR)
        speed = ti.max(closing, 1e-6)
        for k in ti.static(range(len(self.restitutions))):
            row, count, function = ti.static(self.restitutions[k])
            e = function(e, speed, radius, mass, *[self.values[copy, row, p] for p in ti.static(range(count))])
        return DAMPING_FACTOR * damping_ratio_in_step(ti.min(ti.max(e, 1e-3), 1.0))

    @ti.func
    def attraction(self, overlap, radius, modulus, copy=0):
        """Attractive force [N] of two bodies in contact; effective `radius` [m] and `modulus` [Pa]."""
        total = 0.0
        for k in ti.static(range(len(self.attractions))):
            row, count, function = ti.static(self.attractions[k])
            total += function(overlap, radius, modulus, *[self.values[copy, row, p] for p in ti.static(range(count))])
        return total

    @ti.func
    def neck(self, radius, modulus, copy=0):
        """Distance [m] of the surfaces at which an existing contact breaks."""
        longest = 0.0
        for k in ti.static(range(len(self.necks))):
            row, count, function = ti.static(self.necks[k])
            longest = ti.max(
                longest, function(radius, modulus, *[self.values[copy, row, p] for p in ti.static(range(count))])
            )
        return longest


@ti.func
def upwards(gravity):
    """Unit vector against gravity; z without gravity."""
    up = ti.Vector([0.0, 0.0, 1.0])
    if gravity.norm_sqr() > 0.0:
        up = -gravity / gravity.norm()
    return up


@ti.func
def restitution_of(ratio):
    """Restitution of a damping ratio: inverse of `contact.damping_ratio`."""
    e = 1.0
    if ratio < 1.0:
        a = ti.asin(ratio)
        e = ti.exp(-(math.pi - 2.0 * a) * ti.tan(a))
    else:
        b = ti.max(ti.log(ratio + ti.sqrt(ratio * ratio - 1.0)), 1e-9)
        e = ti.exp(-2.0 * b / ti.tanh(b))
    return e


@ti.func
def damping_ratio_in_step(e):
    """`contact.damping_ratio` by bisection, once per impact if the restitution depends on the speed."""
    loss = -ti.log(e)
    ratio = 0.0
    low, high = 0.0, HALF * math.pi
    if loss < 2.0:
        for _ in range(52):
            a = HALF * (low + high)
            if (math.pi - 2.0 * a) * ti.tan(a) < loss:
                low = a
            else:
                high = a
        ratio = ti.sin(HALF * (low + high))
    else:
        low, high = 1e-9, loss
        for _ in range(60):
            b = HALF * (low + high)
            if 2.0 * b / ti.tanh(b) < loss:
                low = b
            else:
                high = b
        b = HALF * (low + high)
        ratio = HALF * (ti.exp(b) + ti.exp(-b))
    return ratio


NODES, WEIGHTS = np.polynomial.legendre.leggauss(16)


@dataclass(frozen=True)
class Adhesion:
    """Attraction in contacts, of all effects together."""

    pull: Callable[[Array, Array, Array], Array]
    """Attractive force [N] of overlap [m], effective radius [m] and modulus [Pa]."""
    reach: Callable[[Array, Array], Array]
    """Distance [m] at which existing contacts break, of effective radius [m] and modulus [Pa]."""

    def holds(self, overlap: Array, radius: Array, modulus: Array) -> npt.NDArray[np.bool_]:
        """Whether existing contacts still hold: some broke in the last move."""
        return np.asarray(overlap > -self.reach(radius, modulus))

    def energy(self, overlap: Array, radius: Array, modulus: Array) -> float:
        """Adhesive energy [J] of contacts, from first touch to their present overlap; negative."""
        total = np.zeros_like(overlap)
        for node, weight in zip(NODES, WEIGHTS, strict=True):
            total -= 0.5 * overlap * weight * self.pull(0.5 * (node + 1) * overlap, radius, modulus)
        return float(total.sum())
