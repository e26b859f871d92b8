"""Find a formula for a disagreement that no listed effect explains, and test it on held-out data.

Terms of a fixed form are fitted one by one.  Terms with shape parameters are screened on a grid of shapes, by one
Newton step each and with part of the data where the disagreement is large; the best of each kind is then fitted with
its shape, and its gain is reduced by a cost for the search over the grid.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from rigtwin.compare.diagnose.data.tracked_lab import TrackedLab
from rigtwin.compare.diagnose.fitting.fit import Fit, by_name, fit, screen
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

HOLDS = 0.8  # share of the excess gap that a formula must close on held-out repetitions
LEAVES = 10.0  # largest gap there in noise floors; residuals of three times the noise do not describe a path
WORSE = 0.05  # relative change of a gap that is within its uncertainty, as the noise floor is estimated
WHOLE = 0.95  # share of the excess gap above which no second term is tried
AT_ONCE = 24  # shapes that are screened in one call
AT_ONCE_EDGED = 12  # the same for shapes with edges, which all use the time steps of the sharpest edge
LEADING = 2  # most promising kinds that are fitted to part of the data
PROMISING = 0.6  # smallest share of the best promised gain for such a fit
LIKELY = 4  # terms of a fixed form that are fitted to convergence
FROM_ZERO = 3.0  # smallest distance of the coefficients from zero in standard deviations; c and d of a period combined
MOVING = 0.05  # share of the highest speed above which a row counts as moving


@dataclass(frozen=True)
class Formula:
    """The best formula, and whether it is reported as a law."""

    candidate: Candidate
    sizes: Gap

    @property
    def share(self) -> float | None:
        """Share of the excess gap that it closes on held-out repetitions; None without a gap there."""
        sizes = self.sizes
        return _closes(sizes.held_out_before, sizes.held_out_after, sizes.held_out_noise_floor)

    @property
    def flaw(self) -> str:
        """Why the formula is not reported as a law; empty if it is.

        It must close enough of the gap on held-out repetitions and leave little there.  In a held-out condition it must
        close part of a gap, and must not widen it if there is none.  A gap that is too small to be seen in the mean
        over all rows must show in the deviance and must not widen.
        """
        share, gain = self.share, self.sizes.held_out_gain
        first, left, floor = self.sizes.held_out_before, self.sizes.held_out_after, self.sizes.held_out_noise_floor
        if first is None or left is None or floor is None:
            return "no formula can be tested on held-out repetitions, because no condition has two"
        if share is None and not (gain is not None and gain >= ALARM):
            return "no formula can be tested on held-out repetitions, because they show no gap"
        if share is None and not left <= (1 + WORSE) * first:
            return "every formula widens the gap on held-out repetitions"
        if share is not None and not share >= HOLDS:  # also false for NaN
            return "no formula closes the gap on held-out repetitions"
        if not left <= LEAVES * floor:
            return "no formula describes held-out repetitions"
        before, after = self.sizes.condition_before, self.sizes.condition_after
        if before is None or after is None:
            return ""
        seen = _closes(before, after, self.sizes.condition_noise_floor) is not None
        if not after <= (1 + WORSE) * before:
            return (
                "every formula that closes the gap elsewhere widens it in the held-out condition "
                f"{self.sizes.condition}"
            )
        if seen and not before - after > WORSE * before:
            return (
                "no formula that closes the gap elsewhere closes any of it in the held-out condition "
                f"{self.sizes.condition}"
            )
        return ""

    @property
    def holds(self) -> bool:
        """Whether the formula is reported as a law."""
        return not self.flaw

    @property
    def words(self) -> str:
        return in_words(self.candidate)


def _closes(before: float | None, after: float | None, floor: float | None) -> float | None:
    """Closed share of the excess gap; None if nothing was held out or there is no gap."""
    if before is None or after is None or floor is None or before <= (1 + WORSE) * floor:
        return None
    return closed(before, after, floor)


def find_formula(bench: Regioned, lab: TrackedLab, naming: Naming, progress: Progress) -> Formula | None:
    """The formula with the largest gain over the baseline and the fewest terms; None if none is significant.

    Terms and shapes are chosen without the repetitions that are held out for the test.
    """
    training = _training(bench, lab, naming)
    chosen = _chosen(training, progress)
    if chosen is None:
        return None
    whole = _on_all(bench, naming, training, chosen)
    return None if whole.reason or whole.gain < FORM else Formula(whole, gap(bench, lab, naming.base, whole.fitted))


@dataclass(frozen=True)
class _Training:
    """The repetitions on which a formula is chosen, and the baseline fitted to them."""

    bench: Regioned
    runs: Sequence[int]
    naming: Naming


def _training(bench: Regioned, lab: TrackedLab, naming: Naming) -> _Training:
    """All repetitions except those held out: the last of each condition, and one whole condition."""
    apart = runs_held_out(bench, lab)
    runs = [run for run in range(len(bench.spans)) if run not in apart]
    if not apart or not runs:
        return _Training(bench, range(len(bench.spans)), naming)
    seen = subset(bench, runs)
    base = fit(seen, near=cut(naming.base, runs), most=20, rounds=2)
    # two repetitions give a poor estimate of their spread: the spread of all repetitions is used then
    location = locate(seen, base) if np.bincount(seen.condition).max() > 2 else naming.location
    return _Training(seen, runs, replace(naming, base=base, location=location))


def _chosen(training: _Training, progress: Progress) -> Candidate | None:
    """The best formula of one term, or of two if one leaves too much; None if none is significant."""
    bench, naming = training.bench, training.naming
    first = any_form(bench, naming, progress)
    if first is None or first.gain < FORM:
        return None
    if _whole(bench, naming, first):
        return first
    second = _with_second(training, first)
    return second if second is not None and second.gain - first.gain > FORM else first


def _with_second(training: _Training, first: Candidate) -> Candidate | None:
    """The best formula of two terms that contains the first."""
    bench, naming = training.bench, training.naming
    rig = bench.lab.rig  # type: ignore[attr-defined]
    more = [term for term in (*nameless(rig), *beside(rig)) if term.name not in first.names]
    likely = sorted(_glanced(bench, first.fitted, more), key=lambda one: one.deviance)[:LEADING]
    fits = [_attempt(bench, one.terms, near=first.fitted, most=15, rounds=2) for one in likely]
    grown = [candidate(naming, one.terms, one, first.cost) for one in fits if one is not None]
    return _better(grown, _shaped(bench, naming, first.fitted, first.cost))


def _on_all(bench: Regioned, naming: Naming, training: _Training, chosen: Candidate) -> Candidate:
    """The chosen formula fitted to all repetitions, starting from its fit to the training repetitions."""
    known = {
        u.name: float(value)
        for u, value in zip(chosen.fitted.unknowns, chosen.fitted.values, strict=True)
        if seen_in(bench, u.name, training.runs)
    }
    local = naming.base.local.copy()
    local[list(training.runs)] = chosen.fitted.local
    near = replace(naming.base, local=local, scatter=chosen.fitted.scatter)
    fitted = fit(bench, chosen.terms, near=near, beside=known, most=25)
    return candidate(naming, chosen.terms, fitted, chosen.cost)


def _attempt(bench: Regioned, terms: tuple[Effect, ...], **how: Any) -> Fit | None:
    """The fit of a formula; None if its equations have no solution for these tracks."""
    try:
        fitted = fit(bench, terms, **how)
    except (np.linalg.LinAlgError, ArithmeticError):
        return None
    return fitted if math.isfinite(fitted.deviance) else None


def _glanced(bench: Regioned, near: Fit, terms: Sequence[Effect]) -> list[Fit]:
    """Each term added to a fit by one Newton step; terms without a finite result are left out."""
    try:
        found = screen(bench, near, terms)
    except (np.linalg.LinAlgError, ArithmeticError):
        if len(terms) <= 1:
            return []
        return [
            fitted for term in terms for fitted in _glanced(bench, near, (term,))
        ]  # one term made the joint equations singular
    return [fitted for fitted in found if math.isfinite(fitted.deviance)]


def any_form(bench: Regioned, naming: Naming, progress: Progress) -> Candidate | None:
    """The best term of a fixed or free form beside the baseline; None if none is valid."""
    rig = bench.lab.rig  # type: ignore[attr-defined]
    plain = fixed_forms(bench, naming, progress, (*nameless(rig), *beside(rig)))
    progress("shapes of formulas", 0, 1)
    return _better(plain, _shaped(bench, naming, naming.base))


def fixed_forms(bench: Regioned, naming: Naming, progress: Progress, terms: Sequence[Effect]) -> list[Candidate]:
    """Fit the most promising nameless terms of a fixed form, each alone on the baseline.

    They are chosen by fits to part of the data where the baseline fits badly, else by one Newton step.
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
            # only a converged formula can be compared with the listed effects
            fitted = _attempt(bench, glanced.terms, near=fitted, most=40, rounds=2)
        if fitted is not None:
            found.append(candidate(naming, glanced.terms, fitted))
    return found


def candidate(naming: Naming, terms: tuple[Effect, ...], fitted: Fit, cost: float = 0.0) -> Candidate:
    """A formula as a candidate: its gain less the cost of its shapes; refused if one of its terms is not valid."""
    spread = spread_of(naming.base, naming.location)
    reason = next((why for term in terms if (why := _amiss(fitted, term))), "")
    gain = (naming.base.deviance - fitted.deviance) / spread - cost
    return Candidate(terms, fitted, gain, reason, cost=cost)


def _amiss(fitted: Fit, term: Effect) -> str:
    """Why a term is not valid: coefficients compatible with zero, or an impossible shape; empty if it is valid."""
    shape = {p.name: fitted.value(f"{term.name}.{p.name}") for p in term.parameters}
    significance = 0.0
    for name in shape.keys() & {"c", "d"}:
        std = fitted.std(f"{term.name}.{name}")
        significance = math.hypot(significance, shape[name] / std if std > 0 else math.nan)
    if not significance >= FROM_ZERO:
        return "its coefficient is within three standard deviations of zero"
    if "low" in shape and not shape["low"] < shape["high"]:
        return "the upper end of its band is below the lower end"
    if any(not shape[name] > 0 for name in shape.keys() & {"reach", "period"}):
        return "its reach or period is not above zero"
    return ""


def in_words(formula: Candidate) -> str:
    """The terms with their coefficients and standard uncertainties."""
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
    """The best term of a fixed form, unless one of a free shape is clearly better."""
    plain = max((one for one in fixed if not one.reason), key=lambda one: one.gain, default=None)
    free = max((one for one in shaped if not one.reason), key=lambda one: one.gain, default=None)
    if plain is None or (free is not None and free.gain - plain.gain > FORM):
        return free
    return plain


def _whole(bench: Regioned, naming: Naming, one: Candidate) -> bool:
    """Whether a formula closes almost all of the gap."""
    share = closed(naming.base.per_row, one.fitted.per_row, noise_floor(bench, one.fitted))
    return share is None or share >= WHOLE


def _shaped(bench: Regioned, naming: Naming, near: Fit, cost: float = 0.0) -> list[Candidate]:
    """Fit the most promising terms of free shape on top of a fit; `cost` is the cost of the shapes in that fit.

    They are chosen with part of the data where the fit is bad, else with all.
    """
    rig = bench.lab.rig  # type: ignore[attr-defined]
    extent = _extent(bench, near)
    kinds = [
        one
        for one in (shapes(rig, extent) if extent else ())
        if one.effect.name not in {term.name for term in near.terms}
        and (one.effect.drive is None or getattr(bench, "drivable", False))
    ]
    part, chosen = coarse(bench) if near.per_row > ROUGH else (bench, list(range(len(bench.spans))))
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
        known = by_name(fitted.unknowns, fitted.values)
        whole = _attempt(bench, terms, near=near, beside=known, most=8, rounds=1)
        if whole is not None and whole.deviance > near.deviance:  # poor minimum: guess releases and impacts anew
            whole = _attempt(bench, terms, near=near, start=known, most=20, rounds=1)
        if whole is not None:
            found.append(candidate(naming, terms, whole, cost + shape.cost))
    return found


def _worth_all(rough: Sequence[tuple[Shape, Fit]], plain: Fit, rows: float, spread: float) -> list[tuple[Shape, Fit]]:
    """The shapes that deserve a fit to all data, from their fits to part of the data.

    `plain` is the fit to that part without them, and all data have `rows` times as many rows.  Left out are shapes that
    would not gain their cost, and shapes significantly worse than the best, in units of its residual variance.
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
    """Promised gain of the best shape of the grid, and its starting values for a fit."""
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
    """Longest duration [s], range of times [s] and largest extent [m] of the motion; None if nothing moves."""
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
