"""Name the effects: forward selection, each candidate fitted together with the unknowns of the baseline."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np

from rigtwin.compare.diagnose.fitting.fit import Fit, by_name, fit, screen, screen_pairs
from rigtwin.compare.diagnose.fitting.normal_equations import Regioned
from rigtwin.compare.diagnose.fitting.strained import STRAINED
from rigtwin.compare.diagnose.fitting.subset import coarse, cut
from rigtwin.compare.diagnose.selection.bent_laws import gained_beside
from rigtwin.compare.diagnose.selection.candidate import Candidate, best_of, front_of, refused
from rigtwin.compare.diagnose.selection.complexity_penalty import SECOND, SECOND_SHARE, price
from rigtwin.compare.diagnose.selection.locate import Location, locate
from rigtwin.lab.progress import Progress
from rigtwin.sim.effects import Effect
from rigtwin.sim.effects.effect import WIDENING

ALARM = 16.0
"""Smallest gain in deviance for a first effect: the best of twenty false effects reaches it once in 1000 labs."""
RIVAL = 0.3  # share of the best gain that a single effect needs to be extended to pairs
ALIKE = 6.0
"""Difference in deviance below which two candidates explain the data equally well."""
AHEAD = 2.0
"""Lead in deviance (odds of e to one) that a special form of an effect needs over a more common one."""
FORM = 25.0
"""Lead in deviance over the listed effects with which a nameless term makes a disagreement unlisted."""
MOST_TERMS = 3  # largest number of effects in a set
MOST_ROUNDS = 6  # largest number of rounds of growing a set
KEEN = 5  # candidates that are fitted beside a root where the disagreement is large
LEADING = 4  # candidates of each size that are fitted to convergence on all data
NOTABLE = 1.0  # difference in deviance below which two fits differ only by rounding
DECADES = 3.0
"""Width in decades of the log-uniform prior of a coefficient, for example rolling friction from 1e-4 to 0.1."""
GLANCE = 6.0  # promised gain in deviance below which a candidate is not fitted
ASTRAY = 0.5  # share of its deviance below which a new fit of the baseline shows that the old one was a poor minimum
FURTHER = 2  # largest number of continuations of a leading candidate's fit that has not converged
ROUGH = 2.0  # chi2 per coordinate above which part of the data separates the candidates
NEARLY_ALL = 0.95  # share of the gap from which what is left may be an error of the law alone; chosen on four labs
# share of that rest, above the noise, from which a second effect is one: those of three labs of independent.py (256/38,
# 256/101, 257/6) close 99.7 % or more, one that is not there closed 92 % (231/52)
NEARLY_ALL_OF_THE_REST = 0.95
NEAR_NOISE = 1.5  # chi2 per coordinate below which a fit describes the data but for their noise
LOST = 20.0  # chi2 per coordinate above which a fit started from the baseline may not converge


@dataclass(frozen=True)
class Naming:
    """All fitted candidates, the best one and its rivals."""

    base: Fit
    location: Location  # of the baseline's residuals
    tried: tuple[Candidate, ...]
    best: Candidate | None
    alike: tuple[Candidate, ...]
    """Other plausible sets that explain the data equally well."""
    after: Location
    """Location for the residuals of the best set, or of the baseline if there is none."""
    rounds: tuple[tuple[Candidate, ...], ...] = ()
    forms: tuple[Candidate, ...] = ()
    """Other forms of the best set (same families of effects) that explain the data equally well."""
    broken: tuple[str, ...] = ()
    """Sets that could not be fitted."""
    unseen: tuple[Effect, ...] = ()
    """Effects of the rig that cannot act in this lab."""


@dataclass
class _Search:
    """The candidates of one lab; with a large disagreement they are screened on part of the data."""

    bench: Regioned
    base: Fit
    spread: float
    done: dict[frozenset[str], Candidate] = field(default_factory=dict)
    rough: tuple[Regioned, Fit] | None = None
    """Part of the data and the baseline's fit to it, if the baseline fits badly."""
    chosen: Sequence[int] = ()
    """Numbers of the repetitions in that part."""
    beside: dict[tuple[frozenset[str], frozenset[str]], float] = field(default_factory=dict)
    """Gain of a set over a smaller one whose laws are free (see `bent_laws`)."""
    broken: dict[str, None] = field(default_factory=dict)
    """Sets whose normal equations were singular."""
    earlier: Mapping[frozenset[str], Candidate] = field(default_factory=dict)
    """Sets fitted beside a baseline that was in a poor minimum."""

    def begin(self) -> None:
        """Choose part of the data if the disagreement is large enough for screening."""
        if self.base.per_row > ROUGH:
            part, self.chosen = coarse(self.bench)
            self.rough = part, fit(part, near=cut(self.base, self.chosen), most=20, rounds=1)

    def consider(self, root: Candidate | None, candidates: Sequence[Effect]) -> list[Candidate]:
        """Fit each candidate added to `root`, or to the baseline if there is none."""
        if root is not None and self.is_part(root.fitted):
            root = self.done[frozenset(root.names)] = self._to_the_end(root)
        near = self.base if root is None else root.fitted
        terms = near.terms
        keys = [frozenset((*near_names(near), effect.name)) for effect in candidates]
        fresh = [e for key, e in zip(keys, candidates, strict=True) if key not in self.done]
        if self.rough is None or near.per_row < ROUGH:
            for first in screen(self.bench, near, fresh):
                newest = first.terms[-1]
                # one Newton step is no estimate where the derivative vanishes at zero, or with an exponent to be found
                dull = near.deviance - first.deviance < GLANCE and not (newest.flat or _has_free_exponent(newest))
                self._add(first) if dull else self._attempt(first.terms, partial(_fit, self.bench, first.terms, near))
        elif fresh:
            part, plain = self.rough
            start = plain
            if root is not None:
                start = root.rough or fit(part, terms, start=_values(near), most=20)
            promise: list[Fit] = screen(part, start, fresh) if root is not None else []
            keen = sorted(promise, key=lambda one: one.deviance)[:KEEN]
            for number, effect in enumerate(fresh):
                hopeless = bool(promise) and all(promise[number] is not one for one in keen)
                more = (*terms, effect)
                self._add(promise[number]) if hopeless else self._attempt(more, partial(_fit, part, more, start))
        return [self.done[key] for key in keys if key in self.done]

    def pairs(self, candidates: Sequence[Effect]) -> list[Candidate]:
        """Fit the pairs that promise far more than their better half: neither effect alone leads to them."""
        part, near = self.rough or (self.bench, self.base)
        keys = []
        for pair in screen_pairs(part, near, candidates, KEEN):
            keys.append(frozenset(term.name for term in pair))
            if keys[-1] not in self.done:
                self._attempt(pair, partial(fit, part, pair, near=near, most=25, rounds=2))
        return [self.done[key] for key in keys if key in self.done]

    def siblings(self, one: Candidate, candidates: Sequence[Effect]) -> list[Candidate]:
        """Fit the set with each effect in turn replaced by another form of its family.

        The form of an effect is determined beside the other effects: alone it also absorbs their residuals.
        """
        part, near = self.bench, one.fitted
        if one.rough is not None and self.rough is not None:
            part, near = self.rough[0], one.rough
        keys = []
        for term in one.terms:
            for other in (e for e in candidates if e.group == term.group and e.name not in one.names):
                keys.append(frozenset((*one.names, other.name)) - {term.name})
                if keys[-1] in self.done:
                    continue
                terms = tuple(other if each is term else each for each in one.terms)
                parameter = other.parameters[0]
                begun = _begun(near, {f"{other.name}.{parameter.name}": parameter.typical})
                self._attempt(terms, partial(fit, part, terms, **begun, most=25, rounds=2))
        return self.polish([self.done[key] for key in keys if key in self.done])

    def settle(self, singles: list[Candidate]) -> list[Candidate]:
        """Fit the baseline again from the best candidate, so that no effect gains by a better local minimum."""
        if self.base.per_row > ROUGH or not singles:
            return singles
        ahead = max(singles, key=lambda one: one.gain)
        if ahead.gain < GLANCE:
            return singles
        again = fit(self.bench, (), near=ahead.fitted, rounds=6)
        better = self.base.deviance - again.deviance
        if better <= 0:
            return singles
        self.base = again
        settled = [replace(one, gain=one.gain - better / self.spread) for one in singles]
        self.done.update({frozenset(one.names): one for one in settled})
        return settled

    def _attempt(self, terms: tuple[Effect, ...], fitting: Callable[[], Fit]) -> None:
        """Fit a candidate; one with singular equations is left out and reported in `broken`."""
        try:
            self._add(fitting())
        except np.linalg.LinAlgError:
            self._no_solution(terms)

    def _completed(self, one: Candidate) -> Candidate:
        """The candidate fitted to convergence on all data; one with singular equations there is refused."""
        try:
            return self._to_the_end(one)
        except np.linalg.LinAlgError:
            self._no_solution(one.terms)
            return replace(one, reason="its equations have no solution for these tracks")

    def _no_solution(self, terms: tuple[Effect, ...]) -> None:
        self.broken[" and ".join(term.title for term in terms)] = None

    def _add(self, fitted: Fit) -> None:
        rough = fitted if self.is_part(fitted) else None
        reason = refused(fitted, fitted.terms)
        self.done[frozenset(near_names(fitted))] = Candidate(fitted.terms, fitted, self._gain(fitted), reason, rough)

    def _gain(self, fitted: Fit) -> float:
        """Gain of a fit over the baseline; that of a fit to part of the data is extrapolated to all data.

        It is assumed that the effect closes the same share of the baseline's gap on all data.
        """
        if not self.is_part(fitted):
            return (self.base.deviance - fitted.deviance) / self.spread + self._spared(fitted)
        assert self.rough is not None
        plain = self.rough[1]
        gaps = [one.chi2 - one.residual.size for one in (self.base, plain)]
        more = gaps[0] / gaps[1] if plain.per_row > NEAR_NOISE else len(self.base.residual) / len(plain.residual)
        return (plain.deviance - fitted.deviance) * more / self.spread + self._spared(fitted)

    def polish(self, candidates: Sequence[Candidate]) -> list[Candidate]:
        """The candidates, with the leading ones fitted to convergence on all data."""
        leading = sorted(candidates, key=lambda one: -one.gain)[:LEADING]
        leading += [one for one in front_of(candidates, 2) if one not in leading]
        result = {frozenset(one.names): one for one in candidates}
        while leading:
            for one in leading:
                if (one.rough is not None or not one.fitted.converged) and (one is leading[0] or not _hopeless(one)):
                    result[frozenset(one.names)] = self._completed(one)
            best = best_of(list(result.values()))
            leading = [best] if best is not None and self.is_part(best.fitted) else []
        result = {key: self._better_earlier(key, one) for key, one in result.items()}
        self.done.update(result)
        return list(result.values())

    def _better_earlier(self, key: frozenset[str], one: Candidate) -> Candidate:
        """The candidate, or its fit beside an earlier baseline if that is the better one on all data."""
        was = self.earlier.get(key)
        if was is None or self.is_part(was.fitted):
            return one
        if not self.is_part(one.fitted) and one.fitted.deviance <= was.fitted.deviance:
            return one
        return replace(was, gain=self._gain(was.fitted), rough=None)

    def reduced(self, more: Candidate, best: Candidate) -> Candidate:
        """The best set after removal of one effect, fitted from the solution of the larger set.

        This finds single effects whose first fit ended in a poor local minimum.
        """
        near = more.fitted
        if self.is_part(near):
            near = replace(near, local=self.base.local, scatter=self.base.scatter)
        rests = [best]
        for term in more.terms:
            left = tuple(one for one in more.terms if one is not term)
            key = frozenset(one.name for one in left)
            if key != frozenset(best.names):
                fitted = fit(self.bench, left, near=near, most=25, rounds=2)
                known = self.done.get(key)
                if known is None or known.gain < self._gain(fitted) or self.is_part(known.fitted):
                    self._add(fitted)
                rests.append(self.done[key])
        return best_of(rests) or best

    def _to_the_end(self, one: Candidate) -> Candidate:
        if one.rough is None:
            fitted = fit(self.bench, one.terms, near=one.fitted, most=40)
        else:
            root = self._root(one)
            near = replace(one.rough, local=root.local, scatter=root.scatter)
            if root.per_row > LOST:
                near = self._carried(one.rough)
            elif root.terms:
                known = by_name(one.rough.unknowns, one.rough.values) | by_name(root.unknowns, root.values)
                near = replace(near, values=np.array([known[unknown.name] for unknown in near.unknowns]))
            fitted = fit(self.bench, one.terms, near=near, most=25, rounds=2)
            if fitted.per_row > min(LOST, self.base.per_row):  # a poor minimum: releases and impacts are guessed anew
                anew = fit(self.bench, one.terms, start=_values(one.fitted), most=25, rounds=2)
                fitted = min(fitted, anew, key=lambda each: each.deviance)
        for _ in range(FURTHER):
            if fitted.converged or fitted.per_row > LOST:
                break
            # nearly interchangeable calibration quantities form a long valley, which needs many steps
            fitted = fit(self.bench, one.terms, near=fitted, most=40)
        return Candidate(one.terms, fitted, self._gain(fitted), refused(fitted, one.terms), one.rough)

    def _root(self, one: Candidate) -> Fit:
        """The best fit to all data with one effect fewer, or that of the baseline."""
        fewer = (self.done.get(frozenset(one.names) - {name}) for name in one.names)
        fits = [known.fitted for known in fewer if known is not None and not self.is_part(known.fitted)]
        return min([self.base, *fits], key=lambda each: each.deviance)

    def _carried(self, rough: Fit) -> Fit:
        """A fit to part of the data as a start for all: each repetition begins like a fitted one of its setting.

        Its own guess may be far off where the baseline does not describe the motion; its moment of release, the first
        local unknown (of a slide its place), is kept.
        """
        local = self.bench.first_guess(by_name(rough.unknowns, rough.values))
        condition = self.bench.condition
        for run in range(len(local)):
            alike = [k for k, known in enumerate(self.chosen) if condition[known] == condition[run]]
            if run in self.chosen:
                local[run] = rough.local[list(self.chosen).index(run)]
            elif alike:
                local[run, 1:] = rough.local[alike[0], 1:]
        return replace(rough, local=local)

    def certified(self, one: Candidate) -> Candidate:
        """The candidate fitted until unknowns and scatter converge, so that the report does not depend on the path."""
        if self.is_part(one.fitted):
            one = self._to_the_end(one)
        fitted = fit(self.bench, one.terms, near=one.fitted, most=40, rounds=12)
        done = replace(one, fitted=fitted, gain=self._gain(fitted), reason=refused(fitted, one.terms))
        self.done[frozenset(one.names)] = done
        return done

    def _spared(self, fitted: Fit) -> float:
        """Gain in deviance for the unknowns of the baseline that the set makes unnecessary."""
        tied = getattr(self.bench, "tied", None)
        return spared(self.base, tied(fitted.terms)) if tied is not None else 0.0

    def earned(self, fewer: Candidate, more: Candidate) -> bool:
        """Whether the further effects of `more` gain their price, or enough even if the laws of `fewer` are free.

        Where effects explain nearly all, but a misfit remains also with a weak one beside them, their law is off, and
        the weak one may only follow that, unless it closes nearly all of what they leave.
        """
        gained = more.score - fewer.score
        left, still = fewer.fitted.per_row, more.fitted.per_row
        explained = left < (1 - NEARLY_ALL) * self.base.per_row
        follows = still > NEAR_NOISE and still - 1 > (1 - NEARLY_ALL_OF_THE_REST) * (left - 1)
        if explained and follows and gained < SECOND_SHARE * fewer.gain:
            return False
        if gained < SECOND or gained >= price(fewer, more, self.bench.lab.rig):  # type: ignore[attr-defined]
            return gained >= SECOND
        key = frozenset(fewer.names), frozenset(more.names)
        if key not in self.beside:
            self.beside[key] = gained_beside(self.bench, fewer, more)
        return self.beside[key] >= SECOND

    def each_needed(self, candidate: Candidate) -> bool:
        """Whether every term gains its price."""
        for term in candidate.terms:
            rest = self.done.get(frozenset(name for name in candidate.names if name != term.name))
            if rest is not None and not self.earned(rest, candidate):
                return False
        return True

    def is_part(self, fitted: Fit) -> bool:
        """Whether a fit used only part of the data."""
        return len(fitted.residual) != len(self.base.residual)


def name_effects(
    bench: Regioned,
    candidates: Sequence[Effect],
    base: Fit,
    progress: Progress,
    earlier: Mapping[frozenset[str], Candidate] | None = None,
) -> Naming:
    """Forward selection over the candidates, from single effects up, with pairs grown from the three best singles.

    `progress` is called with step, number and count.  `earlier` are sets fitted beside a worse baseline.
    """
    location = locate(bench, base)
    search = _Search(bench, base, spread_of(base, location), earlier=earlier or {})
    search.begin()
    progress("candidates", 0, len(candidates))
    singles = search.polish(search.consider(None, candidates))
    singles = search.settle(singles)
    better = _better_base(search, base, singles)
    if better is not None:
        found = name_effects(bench, candidates, better, progress, search.done)
        return replace(found, broken=tuple(dict.fromkeys((*search.broken, *found.broken))))
    best = best_of(singles)
    if best is None or best.score < ALARM:
        none = Naming(search.base, location, tuple(search.done.values()), None, (), location, (tuple(singles),))
        return replace(none, broken=tuple(search.broken))
    best, rounds = _grown(search, best, singles, candidates, progress)
    return replace(_concluded(search, best, location, rounds), broken=tuple(search.broken))


def _better_base(search: _Search, first: Fit, singles: Sequence[Candidate]) -> Fit | None:
    """A much better fit of the baseline than the `first`, found from the best candidate; None if there is none.

    The first was in a poor local minimum then, and so was whatever started from there: the search begins anew, so that
    no candidate gains by that.
    """
    if first.deviance - search.base.deviance > ALARM:
        return search.base
    best = best_of(singles)
    if best is not None and search.base.per_row > ROUGH and not search.is_part(best.fitted):
        again = fit(search.bench, (), near=best.fitted, rounds=6)
        return again if again.deviance < ASTRAY * search.base.deviance else None
    return None


def _grown(
    search: _Search, best: Candidate, singles: Sequence[Candidate], candidates: Sequence[Effect], progress: Progress
) -> tuple[Candidate, list[tuple[Candidate, ...]]]:
    """The best set of effects, grown from the best singles, and the candidates of each round."""
    bench, rounds = search.bench, [tuple(singles)]
    front = [best]
    if best.fitted.per_row > 1.3 or locate(bench, best.fitted).p < 1e-3:
        # one effect is not enough, and the best pair need not contain the best single
        most = math.inf if best.fitted.per_row > ROUGH else LOST
        front = [one for one in front_of(singles, 3) if one.score > RIVAL * best.score and one.fitted.per_row < most]
    count = 2
    while count <= MOST_TERMS and len(rounds) < MOST_ROUNDS:
        if count > 2 and locate(bench, best.fitted).p > 1e-3:
            break
        grown = []
        for number, root in enumerate(front if count == 2 else front[:1]):
            progress("pairs", number, len(front))
            grown += search.consider(root, [effect for effect in candidates if effect.group not in root.groups])
        if count == 2 and len(front) > 1:
            grown += search.pairs(candidates)
        grown = search.polish(grown)
        rounds.append(tuple(grown))
        more = best_of(grown)
        if more is not None and more.score > best.score + SECOND and locate(bench, more.fitted).p < 1e-3:
            # before it is judged: what the plain form of a second effect leaves may be the law of the first
            grown += search.siblings(more, candidates)
            rounds[-1], more = tuple(grown), best_of(grown) or more
        if more is None or not search.earned(best, more):
            break
        fewer = search.reduced(more, best)
        if fewer.score > best.score + NOTABLE and not search.earned(fewer, more):
            best, front = fewer, [fewer]  # as good with one effect fewer: grow again from that set
        elif search.each_needed(more):
            best, front, count = more, front_of(grown, 3), count + 1
        else:
            break
    return best, rounds


def _concluded(search: _Search, best: Candidate, location: Location, rounds: Sequence[tuple[Candidate, ...]]) -> Naming:
    """The best set that is still plausible after convergence, and the sets that explain the data equally well."""
    done, chosen = search.done, search.certified(best)
    while chosen.reason or chosen.score < ALARM:
        rest = best_of([one for one in done.values() if one.score >= ALARM])
        if rest is None:
            return Naming(search.base, location, tuple(done.values()), None, (), location, tuple(rounds))
        chosen = search.certified(rest)
    chosen, others = _plainest(search, chosen)
    forms = tuple(one for one in others if one.groups == chosen.groups)
    # a thin plate and a loss in the bead have similar impact laws but are different causes
    near = [one for one in others if one.groups != chosen.groups or _specials(one) != _specials(chosen)]
    after = locate(search.bench, chosen.fitted)
    return Naming(
        search.base, location, tuple(done.values()), chosen, tuple(_apart(near)), after, tuple(rounds), forms=forms
    )


def _rivals(done: Mapping[frozenset[str], Candidate], chosen: Candidate) -> list[Candidate]:
    """Other plausible sets with the same number of effects that explain the data equally well."""
    same_size = [one for one in done.values() if len(one.terms) == len(chosen.terms) and not one.reason]
    return [one for one in same_size if chosen.score - one.score < ALIKE and one.names != chosen.names]


def _plainest(search: _Search, first: Candidate) -> tuple[Candidate, list[Candidate]]:
    """The form of `first` with the fewest special or free effects among those that fit equally well, and all sets that
    explain the data as well as the better of it and `first`."""

    def plainer() -> list[Candidate]:
        rivals = _rivals(search.done, first)
        return [one for one in rivals if one.groups == first.groups and _extras(one) < _extras(first)]

    for one in plainer():
        # `first` has converged: a fit that has not would be at a disadvantage
        search.certified(one)
    plain = best_of(plainer())
    chosen = plain if plain is not None and first.score - plain.score < AHEAD else first
    most = max(first.score, chosen.score)
    rivals = [one for one in (first, *_rivals(search.done, first)) if one.names != chosen.names]
    return chosen, [one for one in rivals if most - one.score < ALIKE]


def _specials(candidate: Candidate) -> int:
    return sum(term.special for term in candidate.terms)


def _extras(candidate: Candidate) -> int:
    """Number of forms that plain ones of their families go before."""
    return sum(term.special or term.free for term in candidate.terms)


def spared(base: Fit, names: Sequence[str]) -> float:
    """Gain in deviance for replacing these coefficients by one, from the Laplace approximation of the evidence.

    Each coefficient has a log-uniform prior over `DECADES` and a posterior with the covariance of the fit (correlated,
    for example by a common angle error); the single coefficient is known as well as all of them together.  The gain is
    zero where the data determine the coefficients poorly.
    """
    if not names:
        return 0.0
    at = [base.index(name) for name in names]
    if not np.all(base.values[at] > 0):  # at the end of the range the logarithm is undefined
        return 0.0
    relative = base.covariance[np.ix_(at, at)] / np.outer(base.values[at], base.values[at])  # of the logarithms
    sign, volume = np.linalg.slogdet(relative)
    if sign <= 0:
        return 0.0
    together = float(np.linalg.solve(relative, np.ones(len(at))).sum())  # inverse variance of the single coefficient
    if not together > 0:
        return 0.0
    wide = math.log(DECADES * math.log(10) / math.sqrt(2 * math.pi))
    return max(2 * (len(at) - 1) * wide - float(volume) - math.log(together), 0.0)


def spread_of(base: Fit, location: Location) -> float:
    """Variance of the residuals between repetitions over that of white noise; gains are divided by it."""
    # a misfit also differs between repetitions, so the estimate is valid only for a fit near the noise
    return location.spread if base.per_row < NEAR_NOISE else 1.0


def _hopeless(one: Candidate) -> bool:
    """Whether a set of several effects does not fit even the part of the data that it was fitted to."""
    return len(one.terms) > 1 and one.rough is not None and one.rough.per_row > LOST


def near_names(fitted: Fit) -> tuple[str, ...]:
    """Names of the effects of a fit."""
    return tuple(term.name for term in fitted.terms)


def _fit(bench: Regioned, terms: tuple[Effect, ...], near: Fit) -> Fit:
    newest = terms[-1]
    parameter = newest.parameters[0]
    name = f"{newest.name}.{parameter.name}"
    far, lost = near.per_row > ROUGH, near.per_row > LOST
    # the leading candidates are fitted to convergence afterwards
    fitted = partial(fit, bench, terms, most=20 if far else 25, rounds=1 if far else 2)
    if newest.geometry in WIDENING:
        return fitted(near=near)
    fits = [] if newest.flat else [fitted(near=near)]
    if lost or newest.flat or _has_free_exponent(newest):
        for begin in _starts(newest, lost=lost):
            with suppress(np.linalg.LinAlgError):  # a start far from any solution must not lose the others
                fits.append(_strength_first(fitted, newest, _begun(near, begin)))
    elif fits[0].value(name) < parameter.low - 2 * fits[0].std(name):
        # there may be another minimum in the physical range, e.g. lower friction during sliding instead of higher
        # friction with which the clump would climb the arm
        fits.append(fitted(**_begun(near, {name: parameter.typical})))
    if not (lost or near.terms) and max((abs(pull) for pull in near.pulls.values()), default=0.0) > STRAINED:
        # a calibration that the baseline strains may have led into another minimum: begin with the stated one
        fits.append(fitted(start={name: parameter.typical}))
    if not fits:
        raise np.linalg.LinAlgError(f"{newest.name}: singular from every start")
    return min(fits, key=lambda one: one.deviance)


def _has_free_exponent(effect: Effect) -> bool:
    """Whether the law has an exponent that a fit must begin on both sides of its usual value."""
    return effect.free and any(one.starts for one in effect.parameters[1:])


def _strength_first(fitted: Callable[..., Fit], effect: Effect, begun: Mapping[str, Any]) -> Fit:
    """A fit whose coefficients of shape, known beforehand within an uncertainty, are held there at first.

    Far from the solution they would compensate a wrong strength.
    """
    held = {
        f"{effect.name}.{one.name}": one.assumed[0]
        for one in effect.parameters
        if one.assumed is not None and not one.starts
    }
    return fitted(near=fitted(**begun, held=held)) if held else fitted(**begun)


def _starts(effect: Effect, *, lost: bool) -> list[dict[str, float]]:
    """Starting values of the coefficients of an effect: each combination of those that it states."""
    stated = {parameter.name: parameter.starts for parameter in effect.parameters if parameter.starts}
    first = effect.parameters[0]
    if lost and first.typical not in first.starts:
        stated[first.name] = (*first.starts, first.typical)
    return [
        {f"{effect.name}.{name}": value for name, value in zip(stated, values, strict=True)}
        for values in itertools.product(*stated.values())
        if values
    ]


def _begun(near: Fit, begin: Mapping[str, float]) -> dict[str, Any]:
    """Arguments for a fit that starts with these values of some unknowns."""
    if near.per_row > LOST:
        return {"start": {**_values(near), **begin}}
    return {"near": near, "beside": begin}


def _values(near: Fit) -> dict[str, float]:
    return {u.name: float(v) for u, v in zip(near.unknowns, near.values, strict=True) if u.effect}


def _apart(candidates: Sequence[Candidate]) -> list[Candidate]:
    """The best candidate of each family."""
    return front_of(candidates, len(candidates))
