"""The formula of a disagreement that no listed effect explains: nameless terms, and whether they hold where they were
not fitted.

Terms of a fixed form are fitted one by one.  Those of a free shape are first looked at on a grid of shapes, in a part
of the data, by one Newton step each; the best of each kind is then fitted with its shape, and pays for the grid.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from rigtwin.compare.diagnose.data.tracked_lab import TrackedLab
from rigtwin.compare.diagnose.fitting.fit import Fit, fit, screen
from rigtwin.compare.diagnose.fitting.normal_equations import Regioned
from rigtwin.compare.diagnose.fitting.subset import coarse, cut, subset
from rigtwin.compare.diagnose.selection.candidate import Candidate
from rigtwin.compare.diagnose.selection.gap import Gap, closed, gap, noise_floor, runs_held_out, seen_in
from rigtwin.compare.diagnose.selection.locate import locate
from rigtwin.compare.diagnose.selection.name_effects import ALARM, FORM, ROUGH, Naming, spread_of
from rigtwin.lab.formatting import unit_of
from rigtwin.lab.progress import Progress
from rigtwin.sim.effects import Effect
from rigtwin.sim.effects.nameless_shapes import Extent, Shape, shapes
from rigtwin.sim.effects.nameless_terms import beside, nameless

HOLDS = 0.8  # share of the excess that a formula must close on repetitions that it was not fitted to
LEAVES = 10.0  # noise floors that it may leave there: by three times the noise no path is described, whatever it closes
WORSE = 0.05  # of a condition's gap: what is less is the doubt of the gap itself, as its noise floor is estimated
WHOLE = 0.95  # share of the excess beyond which no second term is asked for
AT_ONCE = 24  # shapes that are looked at in one go
AT_ONCE_EDGED = 12  # ... and of those with edges, all of which share the steps that the sharpest asks for
LEADING = 2  # of those that promise most, that are fitted to part of the data
PROMISING = 0.6  # ... and not less than this share of the most
LIKELY = 4  # terms of a fixed form that are fitted to the end
FROM_ZERO = 3.0  # standard deviations that each term's coefficients must be from zero, c and d of a period together
MOVING = 0.05  # of the highest speed, above which something counts as moving


@dataclass(frozen=True)
class Formula:
    """The best formula, and whether it is told as the law."""

    candidate: Candidate
    sizes: Gap

    @property
    def share(self) -> float | None:
        """Share of the excess gap that it closes on repetitions that it was not fitted to; None with no gap there."""
        sizes = self.sizes
        return _closes(sizes.held_out_before, sizes.held_out_after, sizes.held_out_noise_floor)

    @property
    def flaw(self) -> str:
        """Why it is no law, for a sentence that goes on with what the best formula would close; empty where it is one.

        It must close enough of the gap on held-out repetitions and leave little there, and close some of the gap of a
        held-out condition, where there is one; where there is none it may not widen it.  A gap that is too small to be
        seen in the mean over all rows must show in the deviance, and not widen.
        """
        share, gain = self.share, self.sizes.held_out_gain
        first, left, floor = self.sizes.held_out_before, self.sizes.held_out_after, self.sizes.held_out_noise_floor
        if first is None or left is None or floor is None:
            return "none can be held against repetitions that it was not fitted to, for no condition has two"
        if share is None and not (gain is not None and gain >= ALARM):
            return "none can be held against repetitions that it was not fitted to, for there is no gap in such"
        if share is None and not left <= (1 + WORSE) * first:
            return "none does without widening the gap on repetitions that it was not fitted to"
        if share is not None and not share >= HOLDS:  # nor is what is no number a law
            return "none closes the gap on repetitions that it was not fitted to"
        if not left <= LEAVES * floor:
            return "none describes repetitions that it was not fitted to"
        before, after = self.sizes.condition_before, self.sizes.condition_after
        if before is None or after is None:
            return ""
        seen = _closes(before, after, self.sizes.condition_noise_floor) is not None
        if not after <= (1 + WORSE) * before:
            return f"none that closes it elsewhere does without widening it in {self.sizes.condition}, held out whole"
        if seen and not before - after > WORSE * before:
            return f"none that closes it elsewhere closes any of it in {self.sizes.condition}, held out whole"
        return ""

    @property
    def holds(self) -> bool:
        """Whether it is told as the law."""
        return not self.flaw

    @property
    def words(self) -> str:
        return in_words(self.candidate)


def _closes(before: float | None, after: float | None, floor: float | None) -> float | None:
    """Share of the excess that is closed; None where nothing was held out or no gap is seen there."""
    if before is None or after is None or floor is None or before <= (1 + WORSE) * floor:
        return None
    return closed(before, after, floor)


def find_formula(bench: Regioned, lab: TrackedLab, naming: Naming, progress: Progress) -> Formula | None:
    """The formula that gains most on the baseline, of the fewest terms that do; None where none is significant.

    Its terms and shapes are chosen on the repetitions that it is not held against afterwards.
    """
    ground = _ground(bench, lab, naming)
    chosen = _chosen(ground, progress)
    if chosen is None:
        return None
    whole = _on_all(bench, naming, ground, chosen)
    return None if whole.reason or whole.gain < FORM else Formula(whole, gap(bench, lab, naming.base, whole.fitted))


@dataclass(frozen=True)
class _Ground:
    """The repetitions that a formula is chosen on, and the baseline there."""

    bench: Regioned
    runs: Sequence[int]
    naming: Naming


def _ground(bench: Regioned, lab: TrackedLab, naming: Naming) -> _Ground:
    """All that no formula is held against: neither a condition's last repetition nor the condition held out whole."""
    apart = runs_held_out(bench, lab)
    runs = [run for run in range(len(bench.spans)) if run not in apart]
    if not apart or not runs:
        return _Ground(bench, range(len(bench.spans)), naming)
    seen = subset(bench, runs)
    base = fit(seen, near=cut(naming.base, runs), most=20, rounds=2)
    # two repetitions do not tell how they scatter beyond the noise: gains are then counted in the scatter of all
    location = locate(seen, base) if np.bincount(seen.condition).max() > 2 else naming.location
    return _Ground(seen, runs, replace(naming, base=base, location=location))


def _chosen(ground: _Ground, progress: Progress) -> Candidate | None:
    """The formula of one term, or of two where one leaves too much; None where none is significant."""
    bench, naming = ground.bench, ground.naming
    rig = bench.lab.rig  # type: ignore[attr-defined]
    plain = fixed_forms(bench, naming, progress, (*nameless(rig), *beside(rig)))
    progress("shapes of formulas", 0, 1)
    first = _better(plain, _shaped(bench, naming, naming.base))
    if first is None or first.gain < FORM:
        return None
    if _whole(bench, naming, first):
        return first
    second = _with_second(ground, first)
    return second if second is not None and second.gain - first.gain > FORM else first


def _with_second(ground: _Ground, first: Candidate) -> Candidate | None:
    """The best of two terms, one of which is the first."""
    bench, naming = ground.bench, ground.naming
    rig = bench.lab.rig  # type: ignore[attr-defined]
    more = [term for term in (*nameless(rig), *beside(rig)) if term.name not in first.names]
    likely = sorted(_glanced(bench, first.fitted, more), key=lambda one: one.deviance)[:LEADING]
    fits = [_attempt(bench, one.terms, near=first.fitted, most=15, rounds=2) for one in likely]
    grown = [candidate(naming, one.terms, one, first.cost) for one in fits if one is not None]
    return _better(grown, _shaped(bench, naming, first.fitted, first.cost))


def _on_all(bench: Regioned, naming: Naming, ground: _Ground, chosen: Candidate) -> Candidate:
    """The chosen formula fitted to all repetitions, from where it went on those that it was chosen on."""
    known = {
        u.name: float(value)
        for u, value in zip(chosen.fitted.unknowns, chosen.fitted.values, strict=True)
        if seen_in(bench, u.name, ground.runs)
    }
    local = naming.base.local.copy()
    local[list(ground.runs)] = chosen.fitted.local
    near = replace(naming.base, local=local, scatter=chosen.fitted.scatter)
    fitted = fit(bench, chosen.terms, near=near, beside=known, most=25)
    return candidate(naming, chosen.terms, fitted, chosen.cost)


def _attempt(bench: Regioned, terms: tuple[Effect, ...], **how: Any) -> Fit | None:
    """The fit of a formula; None where its equations have no solution for these tracks."""
    try:
        fitted = fit(bench, terms, **how)
    except (np.linalg.LinAlgError, ArithmeticError):
        return None
    return fitted if math.isfinite(fitted.deviance) else None


def _glanced(bench: Regioned, near: Fit, terms: Sequence[Effect]) -> list[Fit]:
    """What each term promises on top of a fit, by one Newton step; those that have none are left out."""
    try:
        found = screen(bench, near, terms)
    except (np.linalg.LinAlgError, ArithmeticError):
        if len(terms) <= 1:
            return []
        return [fitted for term in terms for fitted in _glanced(bench, near, (term,))]  # one of them spoils it for all
    return [fitted for fitted in found if math.isfinite(fitted.deviance)]


def fixed_forms(bench: Regioned, naming: Naming, progress: Progress, terms: Sequence[Effect]) -> list[Candidate]:
    """Nameless terms of a fixed form, each alone on the baseline: those that promise most.

    Where the baseline is far off, part of the data tells which these are; near the noise, one Newton step does.
    """
    near, base = bench, naming.base
    if base.per_row > ROUGH:
        near, chosen = coarse(bench)
        start = cut(base, chosen)
        attempts = [_attempt(near, (term,), near=start, most=20, rounds=1) for term in terms]
        seen = [one for one in attempts if one is not None]
    else:
        seen = _glanced(bench, base, terms)
    promising = sorted(seen, key=lambda one: one.deviance)[:LIKELY]
    found = []
    for number, glanced in enumerate(promising):
        progress("formulas", number, len(promising))
        value = {u.name: glanced.value(u.name) for u in glanced.of(glanced.terms[0].name)}
        fitted = _attempt(bench, glanced.terms, near=base, beside=value, most=15, rounds=2)
        if fitted is not None and not fitted.converged:
            # a formula that is still on its way cannot be held against the listed effects
            fitted = _attempt(bench, glanced.terms, near=fitted, most=40, rounds=2)
        if fitted is not None:
            found.append(candidate(naming, glanced.terms, fitted))
    return found


def candidate(naming: Naming, terms: tuple[Effect, ...], fitted: Fit, cost: float = 0.0) -> Candidate:
    """A formula's fit, and its gain less what its shapes cost; refused where one of its terms cannot be."""
    spread = spread_of(naming.base, naming.location)
    reason = next((why for term in terms if (why := _amiss(fitted, term))), "")
    gain = (naming.base.deviance - fitted.deviance) / spread - cost
    return Candidate(terms, fitted, gain, reason, cost=cost)


def _amiss(fitted: Fit, term: Effect) -> str:
    """Why a term of a formula cannot be: its coefficients may be zero, or its shape is none; empty where it can."""
    shape = {p.name: fitted.value(f"{term.name}.{p.name}") for p in term.parameters}
    of_doubt = 0.0
    for name in shape.keys() & {"c", "d"}:
        std = fitted.std(f"{term.name}.{name}")
        of_doubt = math.hypot(of_doubt, shape[name] / std if std > 0 else math.nan)
    if not of_doubt >= FROM_ZERO:
        return "within three of its standard deviations of zero"
    if "low" in shape and not shape["low"] < shape["high"]:
        return "its band ends below where it begins"
    if any(not shape[name] > 0 for name in shape.keys() & {"reach", "period"}):
        return "a reach or a period that is not above zero"
    return ""


def in_words(formula: Candidate) -> str:
    """The terms with their coefficients and doubts."""
    parts = []
    for term in formula.terms:
        numbers = []
        for parameter in term.parameters:
            name = f"{term.name}.{parameter.name}"
            value, std = formula.fitted.value(name), formula.fitted.std(name)
            numbers.append(f"{parameter.name} = {value:.4g} ± {std:.2g}{unit_of(parameter.unit)}")
        parts.append(f"{term.title} with {', '.join(numbers)}")
    return "; ".join(parts)


def _better(fixed: Sequence[Candidate], shaped: Sequence[Candidate]) -> Candidate | None:
    """The best of a fixed form, unless a free shape does clearly better."""
    plain = max((one for one in fixed if not one.reason), key=lambda one: one.gain, default=None)
    free = max((one for one in shaped if not one.reason), key=lambda one: one.gain, default=None)
    if plain is None or (free is not None and free.gain - plain.gain > FORM):
        return free
    return plain


def _whole(bench: Regioned, naming: Naming, one: Candidate) -> bool:
    """Whether a formula leaves hardly anything of the gap."""
    share = closed(naming.base.per_row, one.fitted.per_row, noise_floor(bench, one.fitted))
    return share is None or share >= WHOLE


def _shaped(bench: Regioned, naming: Naming, near: Fit, cost: float = 0.0) -> list[Candidate]:
    """Terms of free shape on top of a fit, whose own shapes cost something already; those that promise most are fitted.

    Part of the data tells which these are.
    """
    rig = bench.lab.rig  # type: ignore[attr-defined]
    extent = _extent(bench, near)
    kinds = [
        one
        for one in (shapes(rig, extent) if extent else ())
        if one.effect.name not in {term.name for term in near.terms}
        and (one.effect.drive is None or getattr(bench, "drivable", False))
    ]
    part, chosen = coarse(bench)
    plain = _attempt(part, near.terms, near=cut(near, chosen), most=20, rounds=1)
    if plain is None or not kinds:
        return []
    glances = sorted((_glance(part, plain, one) for one in kinds), key=lambda glance: -glance[0])
    rough = []
    for promised, shape, begin in glances[:LEADING]:
        if promised < PROMISING * glances[0][0] or promised <= 0:
            continue
        fitted = _attempt(part, (*near.terms, shape.effect), near=plain, beside=begin, most=20, rounds=1)
        if fitted is not None:
            rough.append((shape, fitted))
    found = []
    spread = spread_of(naming.base, naming.location)
    for shape, fitted in _worth_all(rough, plain, len(near.residual) / len(plain.residual), spread):
        terms = fitted.terms
        known = {u.name: float(v) for u, v in zip(fitted.unknowns, fitted.values, strict=True)}
        whole = _attempt(bench, terms, near=near, beside=known, most=8, rounds=1)
        if whole is not None and whole.deviance > near.deviance:  # lost from the starts of the fit before: guessed anew
            whole = _attempt(bench, terms, near=near, start=known, most=20, rounds=1)
        if whole is not None:
            found.append(candidate(naming, terms, whole, cost + shape.cost))
    return found


def _worth_all(rough: Sequence[tuple[Shape, Fit]], plain: Fit, rows: float, spread: float) -> list[tuple[Shape, Fit]]:
    """The shapes whose fits to part of the data say that they are worth a fit to all, which have `rows` times as many.

    `plain` is the fit to that part without them.  Left out is what would not gain its cost, and what the part has told
    apart from the best: by so much that, in units of what the best leaves, it is no chance.
    """
    if not rough:
        return []
    least = min((fitted for _, fitted in rough), key=lambda fitted: fitted.deviance)
    unit = max(spread, least.per_row)
    return [
        (shape, fitted)
        for shape, fitted in rough
        if rows * (plain.deviance - fitted.deviance) / spread > shape.cost
        and fitted.deviance - least.deviance <= FORM * unit
    ]


def _glance(part: Regioned, start: Fit, shape: Shape) -> tuple[float, Shape, dict[str, float]]:
    """What the best shape of the grid promises, and its numbers to begin a fit with."""
    best, values = -math.inf, dict[str, float]()
    at_once = AT_ONCE if shape.effect.edges is None else AT_ONCE_EDGED
    for first in range(0, len(shape.grid), at_once):
        terms = [shape.frozen(number) for number in range(first, min(first + at_once, len(shape.grid)))]
        for seen in _glanced(part, start, terms):
            gain, term = start.deviance - seen.deviance, seen.terms[-1]
            if gain > best:
                name, number = shape.effect.name, first + terms.index(term)
                best = gain
                values = {f"{name}.{one}": seen.value(f"{term.name}.{one}") for one in shape.linear}
                values |= {f"{name}.{one}": v for one, v in zip(shape.shaping, shape.grid[number], strict=True)}
    return best, shape, values


def _extent(bench: Regioned, fitted: Fit) -> Extent | None:
    """How long things move, over what stretch of the clock, and how far; None where nothing moves."""
    speed = np.hypot(fitted.speed[:, 0], fitted.speed[:, 1])
    moving = speed > MOVING * float(speed.max())
    times, ways = [], []
    for span in bench.spans:
        inside = moving[span]
        if inside.sum() > 2:
            time, place = bench.time[span][inside], bench.rows[span][inside]
            times.append((float(time.min()), float(time.max())))
            ways.append(float(np.hypot(*np.ptp(place, axis=0))))
    if not times or max(ways) <= 0:
        return None
    begin, end = np.array(times).T
    return Extent(float(np.max(end - begin)), float(end.max() - begin.min()), max(ways))
