"""Test whether a second effect improves the fit even if the law of the first effect is free.

The law of a strong effect is known to a few percent only, and the rest must not be named as a second effect.  The law
is made free by adding the first effect times powers of the speed, the size, or the position in the picture, each with a
free coefficient.  A gain beside all of these cannot come from an error in the first law.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

from rigtwin.compare.diagnose.fitting.fit import Fit, fit
from rigtwin.compare.diagnose.fitting.normal_equations import Regioned
from rigtwin.compare.diagnose.selection.candidate import Candidate, surprise
from rigtwin.compare.diagnose.selection.locate import locate
from rigtwin.sim.effects import Effect
from rigtwin.sim.effects.effect import WIDENING, Hook, Parameter
from rigtwin.sim.effects.nameless_terms import nameless

SLOW = 1e-4  # [m/s] or [rad/s], lower limit of the speed in a power
SIZE, SPEED, PLACE = 3e-3, 1.0, 0.3  # [m], [m/s], [m]: reference values at which a power is one
AWAY, LEFT = 1.5, 1e-3
"""Chi2 per coordinate above which, or p-value of the residual statistic below which, a set does not describe the data.
Its single terms cannot be judged then."""

OTHER_SIZE = 1.05  # ratio of largest to smallest bead above which a dependence on the size can be seen
STEPS = 3  # steps of the fit, which is almost linear near the optimum

Power = Callable[..., Any]


def gained_beside(bench: Regioned, fewer: Candidate, more: Candidate) -> float:
    """Gain in deviance of the new effects of `more` if the laws of the effects of `fewer` are free.

    Computed from the significance of each new coefficient; the smallest one if there are several.
    """
    new = [term for term in more.terms if term.name not in fewer.names]
    if len(new) + len(fewer.terms) > len(more.terms):
        return 0.0  # `more` is not an extension of `fewer`
    left = locate(bench, more.fitted)
    if more.fitted.per_row > AWAY or left.p < LEFT or any(term.geometry in WIDENING for term in new):
        return 0.0
    radius = bench.radius  # type: ignore[attr-defined]
    sizes = float(radius.max()) > OTHER_SIZE * float(radius.min())
    bent = [one for term in fewer.terms for one in bends(term, more.fitted, sizes=sizes)]
    free = fit(bench, (*more.terms, *bent), near=more.fitted, most=STEPS, rounds=1)
    stated = {unknown.name: unknown.sd for unknown in fewer.fitted.unknowns if math.isfinite(unknown.sd)}
    gains = []
    for term in new:
        name = f"{term.name}.{term.parameters[0].name}"
        std = math.hypot(free.std(name), stated.get(name, 0.0))
        gains.append((free.value(name) / std) ** 2 - surprise(free, term))
    return min(gains) / max(1.0, left.spread)


def bends(term: Effect, fitted: Fit, *, sizes: bool) -> list[Effect]:
    """Variations of the law of an effect, each an effect with one free coefficient.

    Effects that change the rig itself (a level, a length, a spin) have no law to vary.
    """
    own = [fitted.value(f"{term.name}.{parameter.name}") for parameter in term.parameters] if _has_law(term) else []
    if term.restitution is not None or term.attraction is not None:
        return [
            one for one in nameless("drop") if one.restitution is not None
        ]  # impacts follow the same laws in every rig
    found = []
    for hook, powers in _POWERS.items():
        law = getattr(term, hook)
        if law is not None:
            several = [*powers, *(_sized(power) for power in (_one, *powers))] if sizes and hook in SIZED else powers
            found += [_bent(term, hook, law, power, own, number) for number, power in enumerate(several)]
    return found


def _has_law(term: Effect) -> bool:
    return any(getattr(term, hook) is not None for hook in _POWERS)


def _bent(term: Effect, hook: str, law: Hook, power: Power, own: Sequence[float], number: int) -> Effect:
    """The fitted effect times a power of one of its arguments."""
    plain = _PLAIN[hook]

    def bent(*given: Any) -> Any:
        *motion, c = given
        was, now, by = plain(*motion), law(*motion, *own), c * power(hook, *motion)
        if isinstance(now, tuple):
            return tuple(start + (end - start) * by for start, end in zip(was, now, strict=True))
        return was + (now - was) * by

    name = f"bent:{term.name}:{number}"
    return Effect(name, name, "physical", term.rigs, (Parameter("c", "1", -1e9, 1e9, 0.1),), "", "", **{hook: bent})  # type: ignore[arg-type]


# powers of speed, size and position, from the arguments of a hook


def _one(hook: str, *motion: Any) -> Any:
    return 1.0


def _faster(hook: str, *motion: Any) -> Any:
    squared = motion[0] ** 2 + motion[1] ** 2 if hook == "force" else motion[1] ** 2
    return (squared + SLOW**2) ** 0.5 / SPEED


def _slower(hook: str, *motion: Any) -> Any:
    return 1.0 / _faster(hook, *motion)


def _heavier(_hook: str, *motion: Any) -> Any:
    return motion[2]  # the normal force


def _apart(_hook: str, *motion: Any) -> Any:
    return motion[0] / SIZE  # the distance, or the place


def _sideways(hook: str, *motion: Any) -> Any:
    return (motion[0] if hook == "view" else motion[1]) / PLACE


def _higher(hook: str, *motion: Any) -> Any:
    return (motion[1] if hook == "view" else motion[2]) / PLACE


def _sized(power: Power) -> Power:
    def sized(hook: str, *motion: Any) -> Any:
        return power(hook, *motion) * (motion[SIZED[hook]] / SIZE)

    return sized


SIZED = {"force": 3, "sideways": 1, "rolling": 2}  # index of the radius among the arguments of a hook
_POWERS: dict[str, tuple[Power, ...]] = {
    "force": (_slower, _faster),
    "torque": (_slower, _faster),
    "mutual": (_apart,),
    "sideways": (_apart,),
    "rolling": (_slower, _faster),
    "sliding": (_slower, _faster),
    "onset": (_heavier,),
    "view": (_sideways, _higher),
    "exposure": (_sideways, _higher),
}
_PLAIN: dict[str, Callable[..., Any]] = {
    "force": lambda vx, vy, *_: (0.0 * vx, 0.0 * vy),
    "torque": lambda angle, *_: 0.0 * angle,
    "mutual": lambda distance, *_: 0.0 * distance,
    "sideways": lambda x, *_: 0.0 * x,
    "rolling": lambda mu, *_: mu,
    "sliding": lambda mu, *_: mu,
    "onset": lambda mu, *_: mu,
    "view": lambda x, y, *_: (x, y),
    "exposure": lambda time, *_: time,
}
