"""The formula of a disagreement that no listed effect explains: nameless terms, and whether they hold where they were
not fitted.

Terms of a fixed form are fitted one by one.  Those of a free shape are first looked at on a grid of shapes, in a part
of the data, by one Newton step each; the best of each kind is then fitted with its shape, and pays for the grid.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from rigtwin.compare.diagnose.candidate import Candidate
from rigtwin.compare.diagnose.fit import Fit, fit, screen
from rigtwin.compare.diagnose.gap import Gap, closed, gap, held_out, noise_floor, seen_in
from rigtwin.compare.diagnose.labs import TrackedLab
from rigtwin.compare.diagnose.locate import Regioned
from rigtwin.compare.diagnose.naming import ALARM, FORM, ROUGH, Naming, spread_of
from rigtwin.compare.diagnose.subset import coarse, cut, subset
from rigtwin.lab.progress import Progress
from rigtwin.lab.wording import unit_of
from rigtwin.sim.effects import Effect
from rigtwin.sim.effects.forms import beside, nameless
from rigtwin.sim.effects.shapes import Extent, Shape, shapes

HOLDS = 0.8  # share of the excess that a formula must close on repetitions that it was not fitted to
LEAVES = 10.0  # noise floors that it may leave there: by three times the noise no path is described, whatever it closes
WORSE = 0.05  # of a condition's gap: what is less is the doubt of the gap itself, as its noise floor is estimated
WHOLE = 0.95  # share of the excess beyond which no second term is asked for
AT_ONCE = 24  # shapes that are looked at in one go
AT_ONCE_EDGED = 12  # ... and of those with edges, all of which share the steps that the sharpest asks for
LEADING = 2  # of those that promise most, that are fitted to part of the data
PROMISING = 0.6  # ... and not less than this share of the most
CLOSE = 0.9  # of what the best of these gains there: the others are not fitted to all
LIKELY = 4  # terms of a fixed form that are fitted to all data
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
        seen in the mean over all rows must show in the deviance.
        """
        share, gain = self.share, self.sizes.held_out_gain
        if share is None and not (gain is not None and gain >= ALARM):
            return "none can be held against repetitions that it was not fitted to, for there is no gap in such"
        if share is not None and not share >= HOLDS:  # nor is what is no number a law
            return "none closes the gap on repetitions that it was not fitted to"
        left, floor = self.sizes.held_out_after, self.sizes.held_out_noise_floor
        if left is not None and floor is not None and not left <= LEAVES * floor:
            return "none describes repetitions that it was not fitted to"
        before, after = self.sizes.condition_before, self.sizes.condition_after
        if before is None or after is None:
            return ""
        gapes = _closes(before, after, self.sizes.condition_noise_floor) is not None
        if not after <= (1 + WORSE) * before:
            return f"none that closes it elsewhere does without widening it in {self.sizes.condition}, held out whole"
        if gapes and not before - after > WORSE * before:
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


def find_formula(
    bench: Regioned, lab: TrackedLab, naming: Naming, fixed: Sequence[Candidate], progress: Progress
) -> Formula | None:
    """The formula that gains most on the baseline, of the fewest terms that do; None where none is significant.

    Its terms and shapes are chosen on the repetitions that it is not held against afterwards.  `fixed` are the terms
    of a fixed form that the verdict was held to; more are asked here.
    """
    ground = _ground(bench, lab, naming)
    chosen = _chosen(ground, fixed, progress)
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
    apart = held_out(bench, lab)
    runs = [run for run in range(len(bench.spans)) if run not in apart]
    if not apart or not runs:
        return _Ground(bench, range(len(bench.spans)), naming)
    seen = subset(bench, runs)
    return _Ground(seen, runs, replace(naming, base=fit(seen, near=cut(naming.base, runs), most=20, rounds=2)))


def _chosen(ground: _Ground, fixed: Sequence[Candidate], progress: Progress) -> Candidate | None:
    """The formula of one term, or of two where one leaves too much; None where none is significant."""
    bench, naming = ground.bench, ground.naming
    rig = bench.lab.rig  # type: ignore[attr-defined]
    plain = [
        candidate(naming, one.terms, fit(bench, one.terms, near=cut(one.fitted, ground.runs), most=15, rounds=1))
        for one in fixed
    ]
    plain += fixed_forms(bench, naming, progress, beside(rig))
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
    likely = sorted(screen(bench, first.fitted, more), key=lambda one: one.deviance)[:LEADING]
    grown = [
        candidate(naming, one.terms, fit(bench, one.terms, near=first.fitted, most=15, rounds=2)) for one in likely
    ]
    return _better(grown, _shaped(bench, naming, first.fitted))


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
    return candidate(naming, chosen.terms, fitted)


def fixed_forms(bench: Regioned, naming: Naming, progress: Progress, terms: Sequence[Effect]) -> list[Candidate]:
    """Nameless terms of a fixed form, each alone on the baseline: those that promise most, of all data.

    Where the baseline is far off, part of the data tells which these are; near the noise, one Newton step does.
    """
    near, base = bench, naming.base
    if base.per_row > ROUGH:
        near, chosen = coarse(bench)
        start = cut(base, chosen)
        seen = [fit(near, (term,), near=start, most=20, rounds=1) for term in terms]
    else:
        seen = screen(bench, base, terms)
    promising = sorted(zip(seen, terms, strict=True), key=lambda one: one[0].deviance)[:LIKELY]
    found = []
    for number, (glanced, term) in enumerate(promising):
        progress("formulas", number, len(promising))
        value = {u.name: glanced.value(u.name) for u in glanced.of(term.name)}
        fitted = fit(bench, (term,), near=base, beside=value, most=15, rounds=2)
        if not fitted.converged:  # a formula that is still on its way cannot be held against the listed effects
            fitted = fit(bench, (term,), near=fitted, most=40, rounds=2)
        found.append(candidate(naming, (term,), fitted))
    return found


def candidate(naming: Naming, terms: tuple[Effect, ...], fitted: Fit, cost: float = 0.0) -> Candidate:
    """A formula's fit, and its gain less what its shape costs; refused where one of its terms cannot be."""
    spread = spread_of(naming.base, naming.location)
    reason = next((why for term in terms if (why := _amiss(fitted, term))), "")
    return Candidate(terms, fitted, (naming.base.deviance - fitted.deviance) / spread - cost, reason)


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


def _shaped(bench: Regioned, naming: Naming, near: Fit) -> list[Candidate]:
    """Terms of free shape on top of a fit; those that promise most are fitted."""
    rig = bench.lab.rig  # type: ignore[attr-defined]
    extent = _extent(bench, near)
    kinds = [
        one
        for one in (shapes(rig, extent) if extent else ())
        if one.effect.name not in {term.name for term in near.terms}
        and (one.effect.drive is None or getattr(bench, "drivable", False))
    ]
    part, chosen = coarse(bench)
    start = cut(near, chosen)
    glances = sorted((_glance(part, start, one) for one in kinds), key=lambda glance: -glance[0])
    rough = []
    for promised, shape, begin in glances[:LEADING]:
        if promised < PROMISING * glances[0][0] or promised <= 0:
            continue
        try:
            fitted = fit(part, (*near.terms, shape.effect), near=start, beside=begin, most=20, rounds=1)
        except (np.linalg.LinAlgError, ArithmeticError):  # a shape that these tracks cannot have
            continue
        rough.append((start.deviance - fitted.deviance - shape.cost, shape, fitted))
    found = []
    most = max((gain for gain, _, _ in rough), default=0.0)
    for gain, shape, fitted in rough:
        if gain <= 0 or gain < CLOSE * most:  # part of the data has told it apart from the best
            continue
        terms = fitted.terms
        known = {u.name: float(v) for u, v in zip(fitted.unknowns, fitted.values, strict=True)}
        try:
            whole = fit(bench, terms, near=near, beside=known, most=8, rounds=1)
            if whole.deviance > near.deviance:  # lost from the starts of the fit before: guessed anew
                whole = fit(bench, terms, near=near, start=known, most=20, rounds=1)
        except (np.linalg.LinAlgError, ArithmeticError):
            continue
        found.append(candidate(naming, terms, whole, shape.cost))
    return found


def _glance(part: Regioned, start: Fit, shape: Shape) -> tuple[float, Shape, dict[str, float]]:
    """What the best shape of the grid promises, and its numbers to begin a fit with."""
    best, values = -math.inf, dict[str, float]()
    at_once = AT_ONCE if shape.effect.edges is None else AT_ONCE_EDGED
    for first in range(0, len(shape.grid), at_once):
        numbers = range(first, min(first + at_once, len(shape.grid)))
        terms = [shape.frozen(number) for number in numbers]
        for number, term, seen in zip(numbers, terms, screen(part, start, terms), strict=True):
            gain = start.deviance - seen.deviance
            if math.isfinite(gain) and gain > best:
                name = shape.effect.name
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
