"""Which effect it is: every candidate fitted together with the baseline's own parameters, singly and in pairs."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np

from rigtwin.compare.diagnose.fitting.fit import Fit, fit, screen
from rigtwin.compare.diagnose.fitting.normal_equations import Regioned
from rigtwin.compare.diagnose.fitting.subset import coarse, cut
from rigtwin.compare.diagnose.selection.bent_laws import gained_beside
from rigtwin.compare.diagnose.selection.candidate import Candidate, best_of, front_of, refused
from rigtwin.compare.diagnose.selection.complexity_penalty import SECOND, price
from rigtwin.compare.diagnose.selection.locate import Location, locate
from rigtwin.sim.effects import Effect
from rigtwin.sim.effects.effect import WIDENING

ALARM = 16.0
"""Least gain in deviance for a first effect: what the best of twenty false ones gains once in 1000 labs."""
RIVAL = 0.3  # a single that gains less than this share of the best is no root for pairs
ALIKE = 6.0
"""Candidates closer than this in deviance explain the data equally well."""
AHEAD = 2.0
"""Deviance, odds of e to one: what a form that takes what not every lab has must lead by to be told first."""
FORM = 25.0
"""A nameless term must beat the listed effects by this much to call a disagreement unlisted."""
MOST_TERMS = 3
MOST_ROUNDS = 6  # of growing a set, whatever is still gained
KEEN = 5  # candidates beside a root that are fitted where the disagreement is large
LEADING = 4  # candidates of each size that are fitted to the end on all data
NOTABLE = 1.0  # deviance: less is rounding of the fits
DECADES = 3.0
"""Powers of ten, any alike, in which a coefficient lies that only the data tell: rolling friction from 1e-4 to 0.1."""
GLANCE = 6.0  # a candidate whose first step promises less than this is not fitted to the end
ASTRAY = 0.5  # of the baseline's deviance: what it comes to from a candidate's place, where it had lost its way
FURTHER = 2  # times that the fit of a leading candidate goes on where it has not converged
ROUGH = 2.0  # chi2 per coordinate above which part of the data tells the candidates apart
LOST = 20.0  # ... and above which a fit from the baseline may not find its way

Tell = Callable[[str, float, float], None]


@dataclass(frozen=True)
class Naming:
    """Everything tried and what came of it."""

    base: Fit
    location: Location  # of the baseline's residuals
    tried: tuple[Candidate, ...]
    best: Candidate | None
    alike: tuple[Candidate, ...]
    """Other plausible sets that explain the data equally well."""
    after: Location
    """Of the residuals of the best, or of the baseline where there is none."""
    rounds: tuple[tuple[Candidate, ...], ...] = ()
    forms: tuple[Candidate, ...] = ()
    """Sets of the same families as the best that explain the data equally well."""
    broken: tuple[str, ...] = ()
    """Sets that could not be fitted."""
    unseen: tuple[Effect, ...] = ()
    """Effects of the rig that no data of such a lab could show."""


@dataclass
class _Search:
    """One lab's candidates as they are tried: roughly on a part of the data where the disagreement is large."""

    bench: Regioned
    base: Fit
    spread: float
    done: dict[frozenset[str], Candidate] = field(default_factory=dict)
    rough: tuple[Regioned, Fit] | None = None
    """A part of the data and the baseline's fit to it, where the baseline is far off."""
    beside: dict[tuple[frozenset[str], frozenset[str]], float] = field(default_factory=dict)
    """What sets gain over smaller ones whose laws may be bent."""
    broken: dict[str, None] = field(default_factory=dict)
    """Sets whose equations had no solution."""

    def begin(self) -> None:
        """Take a part of the data where the whole is not needed to tell the candidates apart."""
        if self.base.per_row > ROUGH:
            part, chosen = coarse(self.bench)
            self.rough = part, fit(part, near=cut(self.base, chosen), most=20, rounds=1)

    def consider(self, root: Candidate | None, candidates: Sequence[Effect]) -> list[Candidate]:
        """Each candidate added to the `root`, to the baseline where there is none."""
        if root is not None and self.is_part(root.fitted):
            root = self.done[frozenset(root.names)] = self._to_the_end(root)
        near = self.base if root is None else root.fitted
        terms = near.terms
        keys = [frozenset((*near_names(near), effect.name)) for effect in candidates]
        fresh = [e for key, e in zip(keys, candidates, strict=True) if key not in self.done]
        if self.rough is None or near.per_row < ROUGH:
            for first in screen(self.bench, near, fresh):
                # one step says nothing of an effect that has no slope at zero
                dull = near.deviance - first.deviance < GLANCE and not first.terms[-1].flat
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

    def siblings(self, one: Candidate, candidates: Sequence[Effect]) -> list[Candidate]:
        """The set with each effect in turn in another form of its family.

        Which form of a drag it is, is seen beside the other effects: alone it stood for them too.
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
                begun = _begun(near, f"{other.name}.{parameter.name}", parameter.typical)
                self._attempt(terms, partial(fit, part, terms, **begun, most=25, rounds=2))
        return self.polish([self.done[key] for key in keys if key in self.done])

    def settle(self, singles: list[Candidate]) -> list[Candidate]:
        """Fit the baseline again from where the best candidate went: no effect may gain by a better way found."""
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
        """Fit a candidate; one whose equations have no solution is left out, and told."""
        try:
            self._add(fitting())
        except np.linalg.LinAlgError:
            self.broken[" and ".join(term.title for term in terms)] = None

    def _add(self, fitted: Fit) -> None:
        rough = fitted if self.is_part(fitted) else None
        reason = refused(fitted, fitted.terms)
        self.done[frozenset(near_names(fitted))] = Candidate(fitted.terms, fitted, self._gain(fitted), reason, rough)

    def _gain(self, fitted: Fit) -> float:
        """Of a fit to part of the data as much as it would be on all of them."""
        plain = self.base
        if self.is_part(fitted):
            assert self.rough is not None
            plain = self.rough[1]
        gain = (plain.deviance - fitted.deviance) * len(self.base.residual) / len(plain.residual)
        return gain / self.spread + self._spared(fitted)

    def polish(self, candidates: Sequence[Candidate]) -> list[Candidate]:
        """The leading candidates fitted to the end, on all data."""
        leading = sorted(candidates, key=lambda one: -one.gain)[:LEADING]
        leading += [one for one in front_of(candidates, 2) if one not in leading]
        result = {frozenset(one.names): one for one in candidates}
        while leading:
            for one in leading:
                if (one.rough is not None or not one.fitted.converged) and (one is leading[0] or not _hopeless(one)):
                    result[frozenset(one.names)] = self._to_the_end(one)
            best = best_of(list(result.values()))
            leading = [best] if best is not None and self.is_part(best.fitted) else []
        self.done.update(result)
        return list(result.values())

    def reduced(self, more: Candidate, best: Candidate) -> Candidate:
        """The best of what is left of a set when one of its effects is taken out, fitted from where the set went.

        A single effect whose fit had lost its way is found so.
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
        if one.rough is not None and self.base.per_row > LOST:
            fitted = fit(self.bench, one.terms, start=_values(one.fitted), most=25, rounds=2)
        elif one.rough is not None:
            near = replace(one.rough, local=self.base.local, scatter=self.base.scatter)
            fitted = fit(self.bench, one.terms, near=near, most=25, rounds=2)
        else:
            fitted = fit(self.bench, one.terms, near=one.fitted, most=40)
        for _ in range(FURTHER):
            if fitted.converged or fitted.per_row > LOST:
                break
            # two calibration quantities that almost stand for each other: the way along their valley is long
            fitted = fit(self.bench, one.terms, near=fitted, most=40)
        return Candidate(one.terms, fitted, self._gain(fitted), refused(fitted, one.terms), one.rough)

    def certified(self, one: Candidate) -> Candidate:
        """Fitted on until neither the unknowns nor the scatter change: what is reported of it must not depend on the
        way there."""
        if self.is_part(one.fitted):
            one = self._to_the_end(one)
        fitted = fit(self.bench, one.terms, near=one.fitted, most=40, rounds=12)
        done = replace(one, fitted=fitted, gain=self._gain(fitted), reason=refused(fitted, one.terms))
        self.done[frozenset(one.names)] = done
        return done

    def _spared(self, fitted: Fit) -> float:
        """What it is worth to make do without unknowns of the baseline."""
        tied = getattr(self.bench, "tied", None)
        return spared(self.base, tied(fitted.terms)) if tied is not None else 0.0

    def earned(self, fewer: Candidate, more: Candidate) -> bool:
        """Whether what `more` has beyond `fewer` gains what it must, or enough whatever the law of `fewer`."""
        gained = more.score - fewer.score
        if gained < SECOND or gained >= price(fewer, more, self.bench.lab.rig):  # type: ignore[attr-defined]
            return gained >= SECOND
        key = frozenset(fewer.names), frozenset(more.names)
        if key not in self.beside:
            self.beside[key] = gained_beside(self.bench, fewer, more)
        return self.beside[key] >= SECOND

    def each_needed(self, candidate: Candidate) -> bool:
        """Whether no term can be left out at less than the price of a term."""
        for term in candidate.terms:
            rest = self.done.get(frozenset(name for name in candidate.names if name != term.name))
            if rest is not None and not self.earned(rest, candidate):
                return False
        return True

    def is_part(self, fitted: Fit) -> bool:
        """Whether a fit is to a part of the data alone."""
        return len(fitted.residual) != len(self.base.residual)


def name_effects(bench: Regioned, candidates: Sequence[Effect], base: Fit, tell: Tell) -> Naming:
    """Forward selection over the library, from the fewest terms up, with pairs grown from the three best singles."""
    location = locate(bench, base)
    search = _Search(bench, base, spread_of(base, location))
    search.begin()
    tell("candidates", 0, len(candidates))
    singles = search.polish(search.consider(None, candidates))
    singles = search.settle(singles)
    base = search.base
    best = best_of(singles)
    rounds = [tuple(singles)]
    if best is not None and base.per_row > ROUGH and not search.is_part(best.fitted):
        again = fit(bench, (), near=best.fitted, rounds=6)
        if again.deviance < ASTRAY * base.deviance:
            # the baseline had lost its way and a candidate found it: none may take credit for that
            told = name_effects(bench, candidates, again, tell)
            return replace(told, broken=tuple(dict.fromkeys((*search.broken, *told.broken))))
    if best is None or best.score < ALARM:
        none = Naming(base, location, tuple(search.done.values()), None, (), location, tuple(rounds))
        return replace(none, broken=tuple(search.broken))
    front = [best]
    if best.fitted.per_row > 1.3 or locate(bench, best.fitted).p < 1e-3:
        # one effect does not do: the first of the pair need not be the best single
        most = math.inf if best.fitted.per_row > ROUGH else LOST
        front = [one for one in front_of(singles, 3) if one.score > RIVAL * best.score and one.fitted.per_row < most]
    count = 2
    while count <= MOST_TERMS and len(rounds) < MOST_ROUNDS:
        if count > 2 and locate(bench, best.fitted).p > 1e-3:
            break
        grown = []
        for number, root in enumerate(front if count == 2 else front[:1]):
            tell("pairs", number, len(front))
            grown += search.consider(root, [effect for effect in candidates if effect.group not in root.groups])
        grown = search.polish(grown)
        rounds.append(tuple(grown))
        more = best_of(grown)
        if more is None or not search.earned(best, more):
            break
        if locate(bench, more.fitted).p < 1e-3:
            grown += search.siblings(more, candidates)
            rounds[-1], more = tuple(grown), best_of(grown) or more
        fewer = search.reduced(more, best)
        if fewer.score > best.score + NOTABLE and not search.earned(fewer, more):
            best, front = fewer, [fewer]  # as good with one effect less: the set is grown from there again
        elif search.each_needed(more):
            best, front, count = more, front_of(grown, 3), count + 1
        else:
            break
    return replace(_concluded(search, best, location, rounds), broken=tuple(search.broken))


def _concluded(search: _Search, best: Candidate, location: Location, rounds: Sequence[tuple[Candidate, ...]]) -> Naming:
    """The best that stays plausible when it is fitted to the end, and what explains the data as well."""
    done, chosen = search.done, search.certified(best)
    while chosen.reason or chosen.score < ALARM:
        rest = best_of([one for one in done.values() if one.score >= ALARM])
        if rest is None:
            return Naming(search.base, location, tuple(done.values()), None, (), location, tuple(rounds))
        chosen = search.certified(rest)
    chosen, others = _plainest(search, chosen)
    forms = tuple(one for one in others if one.groups == chosen.groups)
    # a thin plate is another cause than a loss in the bead, though the law of the impact is alike
    near = [one for one in others if one.groups != chosen.groups or _specials(one) != _specials(chosen)]
    after = locate(search.bench, chosen.fitted)
    return Naming(
        search.base, location, tuple(done.values()), chosen, tuple(_apart(near)), after, tuple(rounds), forms=forms
    )


def _rivals(done: Mapping[frozenset[str], Candidate], chosen: Candidate) -> list[Candidate]:
    """Other plausible sets of as many effects that explain the data equally well."""
    same_size = [one for one in done.values() if len(one.terms) == len(chosen.terms) and not one.reason]
    return [one for one in same_size if chosen.score - one.score < ALIKE and one.names != chosen.names]


def _plainest(search: _Search, first: Candidate) -> tuple[Candidate, list[Candidate]]:
    """Of the forms that one set of families takes equally well, the one that asks for the least, and all that explain
    the data as well as the better of it and `first`."""

    def plainer() -> list[Candidate]:
        rivals = _rivals(search.done, first)
        return [one for one in rivals if one.groups == first.groups and _specials(one) < _specials(first)]

    for one in plainer():
        # `first` was fitted to the end: against it a fit that was not would seem to be behind
        search.certified(one)
    plain = best_of(plainer())
    chosen = plain if plain is not None and first.score - plain.score < AHEAD else first
    most = max(first.score, chosen.score)
    rivals = [one for one in (first, *_rivals(search.done, first)) if one.names != chosen.names]
    return chosen, [one for one in rivals if most - one.score < ALIKE]


def _specials(candidate: Candidate) -> int:
    return sum(term.special for term in candidate.terms)


def spared(base: Fit, names: Sequence[str]) -> float:
    """Deviance that one coefficient is worth in the place of these, by Laplace's evidence.

    Each could have lain anywhere in its range and is known to its doubt, which they share in part (an incline that is
    not quite as stated); the one in their place is known as well as all of them together.  Data that say little of each
    are no reason to tie them.
    """
    if not names:
        return 0.0
    at = [base.index(name) for name in names]
    if not np.all(base.values[at] > 0):  # at the end of its range: nothing is known of its logarithm
        return 0.0
    doubts = base.covariance[np.ix_(at, at)] / np.outer(base.values[at], base.values[at])  # of the logarithms
    sign, volume = np.linalg.slogdet(doubts)
    if sign <= 0:
        return 0.0
    together = float(np.linalg.solve(doubts, np.ones(len(at))).sum())  # one over the variance of the one in their place
    if not together > 0:
        return 0.0
    wide = math.log(DECADES * math.log(10) / math.sqrt(2 * math.pi))
    return max(2 * (len(at) - 1) * wide - float(volume) - math.log(together), 0.0)


def spread_of(base: Fit, location: Location) -> float:
    """By how much the residuals of repetitions scatter beyond the stated noise; gains are counted in it."""
    # a misfit differs from repetition to repetition too; only a fit near the noise tells of the noise
    return location.spread if base.per_row < 1.5 else 1.0


def _hopeless(one: Candidate) -> bool:
    """Whether a set of several effects is no description of the part of the data that it was fitted to."""
    return len(one.terms) > 1 and one.rough is not None and one.rough.per_row > LOST


def near_names(fitted: Fit) -> tuple[str, ...]:
    """The names of a fit's effects."""
    return tuple(term.name for term in fitted.terms)


def _fit(bench: Regioned, terms: tuple[Effect, ...], near: Fit) -> Fit:
    newest = terms[-1]
    parameter = newest.parameters[0]
    name = f"{newest.name}.{parameter.name}"
    far, lost = near.per_row > ROUGH, near.per_row > LOST
    # the leading ones are fitted to the end afterwards
    fitted = partial(fit, bench, terms, most=20 if far else 25, rounds=1 if far else 2)
    if newest.geometry in WIDENING:
        return fitted(near=near)
    fits = [] if newest.flat else [fitted(near=near)]
    starts = (*parameter.starts, *((parameter.typical,) if lost and parameter.typical not in parameter.starts else ()))
    if lost or newest.flat:
        fits += [fitted(**_begun(near, name, value)) for value in starts]
    elif fits[0].value(name) < parameter.low - 2 * fits[0].std(name):
        # there may be another minimum on the physical side: a clump that is held less once it slides, against one
        # that is held more and climbs the arm before it slides
        fits.append(fitted(**_begun(near, name, parameter.typical)))
    return min(fits, key=lambda one: one.deviance)


def _begun(near: Fit, name: str, value: float) -> dict[str, Any]:
    """Where a fit begins that is to find its way from this value of an unknown."""
    if near.per_row > LOST:
        return {"start": {**_values(near), name: value}}
    return {"near": near, "beside": {name: value}}


def _values(near: Fit) -> dict[str, float]:
    return {u.name: float(v) for u, v in zip(near.unknowns, near.values, strict=True) if u.effect}


def _apart(candidates: Sequence[Candidate]) -> list[Candidate]:
    """One of each family."""
    return front_of(candidates, len(candidates))
