"""Which effect it is: every candidate fitted together with the baseline's own parameters, singly and in pairs."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

from rigtwin.compare.diagnose.fit import Fit, fit, screen
from rigtwin.compare.diagnose.locate import Location, Regioned, locate
from rigtwin.compare.diagnose.subset import coarse, cut
from rigtwin.sim.effects import Effect
from rigtwin.sim.effects.effect import WIDENING

ALARM = 16.0
"""Least gain in deviance for a first effect: what the best of twenty false ones gains once in 1000 labs."""
SECOND = 20.0
"""Least further gain for one more effect ..."""
SECOND_SHARE, SECOND_MOST = 0.02, 1500.0
"""... and this share of what was gained before, up to a limit, where it could be what is left of the first: a strong
effect whose law is known to a few percent leaves something that is no second effect."""
OTHER_SHARE = 1e-4
"""As `SECOND_SHARE`, for one more effect that acts elsewhere: in the picture, where the first acts on the motion."""
ACROSS_MOST = 100.0
"""As `SECOND_MOST`, for one that acts across a drop where the first acts along it, or on when a clump slips where the
first acts on how it slides: no law of the one shows there."""
RIVAL = 0.3  # a single that gains less than this share of the best is no root for pairs
ALIKE = 6.0
"""Candidates closer than this in deviance explain the data equally well."""
FORM = 25.0
"""A nameless term must beat the listed effects by this much to call a disagreement unlisted."""
MOST_TERMS = 3
MOST_ROUNDS = 6  # of growing a set, whatever is still gained
JITTER = 24.0  # deviance
WHITE = 0.6  # of the squared differences of white noise
KEEN = 5  # candidates beside a root that are fitted where the disagreement is large
LEADING = 4  # candidates of each size that are fitted to the end on all data
NOTABLE = 1.0  # deviance: less is rounding of the fits
SPARED = 10.0  # deviance: 2 ln(1/0.007), a coefficient that falls to within a percent where it was foretold
BEYOND = 0.1  # of a coefficient's range above it, that its doubt excuses at most
GLANCE = 6.0  # a candidate whose first step promises less than this is not fitted to the end
ASTRAY = 0.5  # of the baseline's deviance: what it comes to from a candidate's place, where it had lost its way
ROUGH = 2.0  # chi2 per coordinate above which part of the data tells the candidates apart
LOST = 20.0  # ... and above which a fit from the baseline may not find its way

Tell = Callable[[str, float, float], None]


@dataclass(frozen=True)
class Candidate:
    """A set of effects and its fit."""

    terms: tuple[Effect, ...]
    fitted: Fit
    gain: float
    """Deviance of the baseline less its own, over the spread of the residuals; higher is better."""
    reason: str = ""
    """Why it is refused, empty where it is plausible."""
    rough: Fit | None = None
    """Its fit to a part of the data, where that was looked at first."""

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(term.name for term in self.terms)

    @property
    def groups(self) -> frozenset[str]:
        return frozenset(term.group for term in self.terms)

    @property
    def score(self) -> float:
        """Gain less the surprise of its coefficients where physics predicts them."""
        return self.gain - sum(_surprise(self.fitted, term) for term in self.terms)


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
                self._add(first if dull else _fit(self.bench, first.terms, near))
        elif fresh:
            part, plain = self.rough
            start = plain
            if root is not None:
                start = root.rough or fit(part, terms, start=_values(near), most=20)
            promise: list[Fit] = screen(part, start, fresh) if root is not None else []
            keen = sorted(promise, key=lambda one: one.deviance)[:KEEN]
            for number, effect in enumerate(fresh):
                hopeless = bool(promise) and all(promise[number] is not one for one in keen)
                self._add(promise[number] if hopeless else _fit(part, (*terms, effect), start))
        return [self.done[key] for key in keys]

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
                begun = {f"{other.name}.{other.parameters[0].name}": other.parameters[0].typical}
                if near.per_row > LOST:
                    self._add(fit(part, terms, start={**_values(near), **begun}, most=25, rounds=2))
                else:
                    self._add(fit(part, terms, near=near, beside=begun, most=25, rounds=2))
        return self.polish([self.done[key] for key in keys])

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

    def _add(self, fitted: Fit) -> None:
        plain = self.base
        if part := self.is_part(fitted):
            assert self.rough is not None
            plain = self.rough[1]
        gain = (plain.deviance - fitted.deviance) * len(self.base.residual) / len(plain.residual)
        self.done[frozenset(near_names(fitted))] = Candidate(
            fitted.terms,
            fitted,
            gain / self.spread + self._spared(fitted),
            _refused(fitted, fitted.terms),
            fitted if part else None,
        )

    def polish(self, candidates: Sequence[Candidate]) -> list[Candidate]:
        """The leading candidates fitted to the end, on all data."""
        leading = sorted(candidates, key=lambda one: -one.gain)[:LEADING]
        leading += [one for one in _front(candidates, 2) if one not in leading]
        result = {frozenset(one.names): one for one in candidates}
        while leading:
            for one in leading:
                if one.rough is not None or not one.fitted.converged:
                    result[frozenset(one.names)] = self._to_the_end(one)
            best = _best(list(result.values()))
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
                gain = (self.base.deviance - fitted.deviance) / self.spread + self._spared(fitted)
                known = self.done.get(key)
                if known is None or known.gain < gain or self.is_part(known.fitted):
                    self.done[key] = Candidate(left, fitted, gain, _refused(fitted, left))
                rests.append(self.done[key])
        return _best(rests) or best

    def _to_the_end(self, one: Candidate) -> Candidate:
        if one.rough is not None and self.base.per_row > LOST:
            fitted = fit(self.bench, one.terms, start=_values(one.fitted), most=25, rounds=2)
        elif one.rough is not None:
            near = replace(one.rough, local=self.base.local, scatter=self.base.scatter)
            fitted = fit(self.bench, one.terms, near=near, most=25, rounds=2)
        else:
            fitted = fit(self.bench, one.terms, near=one.fitted, most=40)
        gain = (self.base.deviance - fitted.deviance) / self.spread + self._spared(fitted)
        return Candidate(one.terms, fitted, gain, _refused(fitted, one.terms), one.rough)

    def certified(self, one: Candidate) -> Candidate:
        """Fitted on until neither the unknowns nor the scatter change: what is reported of it must not depend on the
        way there."""
        if self.is_part(one.fitted):
            one = self._to_the_end(one)
        fitted = fit(self.bench, one.terms, near=one.fitted, most=40, rounds=12)
        gain = (self.base.deviance - fitted.deviance) / self.spread + self._spared(fitted)
        done = replace(one, fitted=fitted, gain=gain, reason=_refused(fitted, one.terms))
        self.done[frozenset(one.names)] = done
        return done

    def _spared(self, fitted: Fit) -> float:
        """What it is worth to make do without unknowns of the baseline."""
        tied = getattr(self.bench, "tied", None)
        return SPARED * tied(fitted.terms) if tied is not None else 0.0

    def is_part(self, fitted: Fit) -> bool:
        """Whether a fit is to a part of the data alone."""
        return len(fitted.residual) != len(self.base.residual)


def name_effects(bench: Regioned, candidates: Sequence[Effect], base: Fit, tell: Tell) -> Naming:
    """Forward selection over the library, from the fewest terms up, with pairs grown from the three best singles."""
    location = locate(bench, base)
    rig = bench.lab.rig  # type: ignore[attr-defined]
    search = _Search(bench, base, spread_of(base, location))
    search.begin()
    tell("candidates", 0, len(candidates))
    singles = search.polish(search.consider(None, candidates))
    singles = search.settle(singles)
    base = search.base
    best = _best(singles)
    rounds = [tuple(singles)]
    if best is not None and base.per_row > ROUGH and not search.is_part(best.fitted):
        again = fit(bench, (), near=best.fitted, rounds=6)
        if again.deviance < ASTRAY * base.deviance:
            # the baseline had lost its way and a candidate found it: none may take credit for that
            return name_effects(bench, candidates, again, tell)
    if best is None or best.score < ALARM:
        return Naming(base, location, tuple(search.done.values()), None, (), location, tuple(rounds))
    front = [best]
    if best.fitted.per_row > 1.3 or locate(bench, best.fitted).p < 1e-3:
        # one effect does not do: the first of the pair need not be the best single
        most = math.inf if best.fitted.per_row > ROUGH else LOST
        front = [one for one in _front(singles, 3) if one.score > RIVAL * best.score and one.fitted.per_row < most]
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
        more = _best(grown)
        if more is None or more.score - best.score < _price(best, more, rig):
            break
        if locate(bench, more.fitted).p < 1e-3:
            grown += search.siblings(more, candidates)
            rounds[-1], more = tuple(grown), _best(grown) or more
        fewer = search.reduced(more, best)
        if fewer.score > best.score + NOTABLE and more.score - fewer.score < _price(fewer, more, rig):
            best, front = fewer, [fewer]  # as good with one effect less: the set is grown from there again
        elif _each_needed(more, search.done, rig):
            best, front, count = more, _front(grown, 3), count + 1
        else:
            break
    return _concluded(search, best, location, rounds)


def _concluded(search: _Search, best: Candidate, location: Location, rounds: Sequence[tuple[Candidate, ...]]) -> Naming:
    """The best that stays plausible when it is fitted to the end, and what explains the data as well."""
    done, chosen = search.done, search.certified(best)
    while chosen.reason or chosen.score < ALARM:
        rest = _best([one for one in done.values() if one.score >= ALARM])
        if rest is None:
            return Naming(search.base, location, tuple(done.values()), None, (), location, tuple(rounds))
        chosen = search.certified(rest)
    same_size = [one for one in done.values() if len(one.terms) == len(chosen.terms) and not one.reason]
    near = [one for one in same_size if chosen.score - one.score < ALIKE and one.groups != chosen.groups]
    after = locate(search.bench, chosen.fitted)
    return Naming(search.base, location, tuple(done.values()), chosen, tuple(_apart(near)), after, tuple(rounds))


def spread_of(base: Fit, location: Location) -> float:
    """By how much the residuals of repetitions scatter beyond the stated noise; gains are counted in it."""
    # a misfit differs from repetition to repetition too; only a fit near the noise tells of the noise
    return location.spread if base.per_row < 1.5 else 1.0


def near_names(fitted: Fit) -> tuple[str, ...]:
    """The names of a fit's effects."""
    return tuple(term.name for term in fitted.terms)


def _fit(bench: Regioned, terms: tuple[Effect, ...], near: Fit) -> Fit:
    newest = terms[-1]
    parameter = newest.parameters[0]
    far = near.per_row > ROUGH
    rounds = 1 if far else 2
    most = 20 if far else 25  # the leading ones are fitted to the end afterwards
    widens = newest.geometry in WIDENING
    name = f"{newest.name}.{parameter.name}"
    fits = [] if newest.flat and not widens else [fit(bench, terms, near=near, most=most, rounds=rounds)]
    lost = near.per_row > LOST
    starts = (*parameter.starts, *((parameter.typical,) if lost and parameter.typical not in parameter.starts else ()))
    if (lost or newest.flat) and not widens:
        for value in starts:
            if lost:
                fits.append(fit(bench, terms, start={**_values(near), name: value}, most=most, rounds=rounds))
            else:
                fits.append(fit(bench, terms, near=near, beside={name: value}, most=most, rounds=rounds))
    elif not widens and fits[0].value(name) < parameter.low - 2 * fits[0].std(name):
        # there may be another minimum on the physical side: a clump that is held less once it slides, against one
        # that is held more and climbs the arm before it slides
        fits.append(fit(bench, terms, near=near, beside={name: parameter.typical}, most=most, rounds=rounds))
    return min(fits, key=lambda one: one.deviance)


def _values(near: Fit) -> dict[str, float]:
    return {u.name: float(v) for u, v in zip(near.unknowns, near.values, strict=True) if u.effect}


def _best(candidates: Sequence[Candidate]) -> Candidate | None:
    return max((one for one in candidates if not one.reason), key=lambda one: one.score, default=None)


def _front(candidates: Sequence[Candidate], count: int) -> list[Candidate]:
    """The best of each family, plausible or nearly so."""
    front: list[Candidate] = []
    for one in sorted((c for c in candidates if not c.reason), key=lambda c: -c.score):
        if all(one.groups != other.groups for other in front):
            front.append(one)
    return front[:count]


def _apart(candidates: Sequence[Candidate]) -> list[Candidate]:
    """One of each family."""
    return _front(candidates, len(candidates))


def _price(fewer: Candidate, more: Candidate, rig: str) -> float:
    """What one more effect must gain."""
    old = {place for term in fewer.terms for place in _places(term)}
    new = [term for term in more.terms if term.name not in fewer.names]
    alike = any(old & _places(term) for term in new)
    across = _crossed(new, fewer.terms, rig)
    left = (SECOND_SHARE if alike else OTHER_SHARE) * fewer.gain
    price = min(left, ACROSS_MOST if across else SECOND_MOST, _feigned(fewer, more, new, left))
    return max(SECOND, price)


def _feigned(fewer: Candidate, more: Candidate, new: Sequence[Effect], left: float) -> float:
    """What it gains to set a stated calibration quantity free, where all `left` of the first effects went to it.

    Data that know it far better than it is stated move it by little, whatever is left over.
    """
    stated = {unknown.name: unknown.sd for unknown in fewer.fitted.unknowns if math.isfinite(unknown.sd)}
    names = [f"{term.name}.{parameter.name}" for term in new for parameter in term.parameters]
    if any(name not in stated for name in names):
        return math.inf
    moved = max(math.sqrt(max(left, 0.0)) * more.fitted.std(name) / stated[name] for name in names)
    return (moved + math.sqrt(SECOND)) ** 2


def _crossed(new: Sequence[Effect], old: Sequence[Effect], rig: str) -> bool:
    """Whether the new effects show, to first order, where the old ones do not show at all."""
    if rig == "drop":
        return all(_across(one) for one in new) and not any(_across(one) for one in old)
    # each run's own friction stands between when it slips and how it slides
    return rig == "slide" and all(one.onset is not None for one in new) and all(one.sliding is not None for one in old)


def _across(term: Effect) -> bool:
    """Whether an effect shows across the fall alone, to first order."""
    return term.geometry in ("level", "release_spin") or term.name == "camera_roll"


def _places(term: Effect) -> set[str]:
    """Where an effect acts: in motion, at impacts, in friction, in the picture, in the time of the frames."""
    hooks = {
        "motion": (term.force, term.torque),
        "impact": (term.restitution, term.attraction),
        "friction": (term.rolling, term.sliding, term.onset),
        "picture": (term.view,),
        "time": (term.exposure,),
    }
    found = {place for place, own in hooks.items() if any(hook is not None for hook in own)} or {term.geometry}
    return found | {"motion"} if _late_by_place(term) else found


def _late_by_place(term: Effect) -> bool:
    """Whether rows are late by where the bead is, which looks like a drag; a wrong clock is wrong alike everywhere."""
    if term.exposure is None:
        return False
    size = term.parameters[0].typical
    return bool(term.exposure(1.0, 0.0, 0.0, size) != term.exposure(1.0, 0.0, 1.0, size))


def _each_needed(candidate: Candidate, done: dict[frozenset[str], Candidate], rig: str) -> bool:
    """Whether no term can be left out at less than the price of a term."""
    for term in candidate.terms:
        rest = done.get(frozenset(name for name in candidate.names if name != term.name))
        if rest is not None and candidate.score - rest.score < _price(rest, candidate, rig):
            return False
    return True


def _refused(fitted: Fit, terms: Sequence[Effect]) -> str:
    """Why a fit's coefficients cannot be: out of their physical range, or not larger than their own doubt."""
    for term in terms:
        if term.geometry == "scatter":
            if float(fitted.scatter[-1]) <= 1.02 * term.parameters[0].least:
                return "rebounds scatter no more than those of a sphere"
            continue
        if term.geometry == "jitter":
            least = term.parameters[0].least
            if fitted.jitter < least:
                return f"a jitter below {least:g} s is in any record"
            if fitted.white < WHITE:
                return "what is left goes on from frame to frame, which jitter does not"
            continue
        for parameter in term.parameters:
            if parameter.assumed is not None:
                continue
            name = f"{term.name}.{parameter.name}"
            value, std = fitted.value(name), fitted.std(name)
            beyond = parameter.high + min(2 * std, BEYOND * (parameter.high - parameter.low))
            if value < parameter.low - 2 * std or value > beyond:
                return (
                    f"{parameter.name} = {value:.3g} {parameter.unit} is not in {parameter.low:g} to {parameter.high:g}"
                )
            if abs(value) < parameter.least:
                return f"{parameter.name} = {value:.3g} {parameter.unit} is no more than any lab has"
            if abs(value) < 3.0 * std:
                return f"{parameter.name} = {value:.3g} is within three of its standard deviations ({std:.2g}) of zero"
    return ""


def _surprise(fitted: Fit, term: Effect) -> float:
    """Twice the log of how much less likely a coefficient is than the predicted one; a factor of two costs one.

    Noise that is not quite white looks like a little jitter: that has to gain more.
    """
    total = JITTER if term.geometry == "jitter" else 0.0
    for parameter in term.parameters:
        if parameter.predicted and term.geometry not in WIDENING:
            value = abs(fitted.value(f"{term.name}.{parameter.name}"))
            ratio = math.log(max(value, 1e-9) / parameter.predicted) / math.log(2)
            total += min(ratio * ratio, 5.0)
    return total
