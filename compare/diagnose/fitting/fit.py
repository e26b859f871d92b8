"""Nested least squares: global unknowns of a rig together with the releases and impacts of every repetition.

The local unknowns of a repetition affect only its own data, so they are eliminated block by block (Schur complement).
Scatter between impacts is a random effect: its standard deviation is estimated along with them, and the deviance
integrates the local unknowns out (Laplace approximation).  Calibration quantities (scale, clock, roll, level, length)
are unknowns with their stated uncertainties as priors, so that no effect gains by explaining a calibration error.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from rigtwin.compare.diagnose.fitting.impact_scatter import expect_scatter, jitter_of
from rigtwin.compare.diagnose.fitting.levenberg_marquardt import HOPELESS, NOTHING, descend, newton_step, promised
from rigtwin.compare.diagnose.fitting.normal_equations import Bench, Linear, State, linearise, noise, spread_of_each
from rigtwin.compare.diagnose.models.unknown import Unknown
from rigtwin.lab.arrays import Array
from rigtwin.sim.effects import Effect
from rigtwin.sim.effects.effect import WIDENING

WIDEST = 1.0  # largest scatter of a restitution, friction or relative scale [1], of a height [m] or a speed [m/s]
# mean square of the residuals of a repetition over the median of all, above which it is fitted anew: in a lab drawn by
# another code two repetitions had 15 and 27, the others at most 1.1
FAR_OFF = 4.0
LAST = 6  # largest number of steps after the last update of the scatter


@dataclass(frozen=True)
class Fit:
    """A model fitted to a lab."""

    terms: tuple[Effect, ...]
    unknowns: tuple[Unknown, ...]
    values: Array  # (G,)
    local: Array  # (R, L)
    scatter: Array  # (H,)
    jitter: float  # [s]
    covariance: Array  # (G, G)
    robust: Array  # (G,), standard deviations from the scatter between repetitions
    deviance: float
    """-2 log of the likelihood with all random effects integrated out, priors included."""
    chi2: float
    """Sum of squared data residuals over the stated noise."""
    objective: float
    """The deviance before anything is integrated out: residuals, deviations of the impacts and priors, squared."""
    pulls: Mapping[str, float]
    residual: Array  # (N, 2), in units of the noise
    speed: Array  # (N, 2) [m/s]
    seen: Array  # (N, 2) [m]
    converged: bool
    soft: Array = field(default_factory=lambda: np.zeros((0, 0)))
    """(R, S), deviations of the impacts from the contact law."""
    white: float = 1.0
    """Mean squared difference of successive residuals over twice their mean square: 1 for white noise."""
    leverage: float = 0.0
    """Effective number of fitted parameters."""
    jitter_std: float = math.nan  # [s]
    kicks: int = 0
    """Number of impacts behind the last entry of `scatter`."""
    by_run: Array = field(default_factory=lambda: np.zeros(0))
    """(R,), share of each repetition in the deviance; the rest are the priors of the global unknowns."""
    frame: float = math.nan  # [s], median time step

    @property
    def per_row(self) -> float:
        """chi2 per coordinate."""
        return self.chi2 / max(self.residual.size, 1)

    def value(self, name: str) -> float:
        return float(self.values[self.index(name)])

    def std(self, name: str) -> float:
        """The larger of the formal and the repetition-robust standard deviation."""
        at = self.index(name)
        return max(math.sqrt(max(self.covariance[at, at], 0.0)), float(self.robust[at]))

    def std_given(self, name: str, others: Sequence[str]) -> float:
        """The standard deviation if the others were known: a strength may be sure where its exponent is not."""
        at = [self.index(one) for one in (name, *others)]
        stds = np.sqrt(np.maximum(np.diag(self.covariance)[at], 0.0))
        if not (stds > 0).all():
            return self.std(name)
        correlation = self.covariance[np.ix_(at, at)] / np.outer(stds, stds)
        explained = correlation[0, 1:] @ np.linalg.pinv(correlation[1:, 1:]) @ correlation[1:, 0]
        return self.std(name) * math.sqrt(max(1 - float(explained), 0.0))

    def index(self, name: str) -> int:
        return [unknown.name for unknown in self.unknowns].index(name)

    def of(self, effect: str) -> list[Unknown]:
        return [unknown for unknown in self.unknowns if unknown.effect == effect]


def fit(
    bench: Bench,
    terms: Sequence[Effect] = (),
    *,
    near: Fit | None = None,
    start: Mapping[str, float] | None = None,
    local: Array | None = None,
    use: Array | None = None,
    most: int = 40,
    held: Mapping[str, float] | None = None,
    beside: Mapping[str, float] | None = None,
    rounds: int = 3,
) -> Fit:
    """Fit the baseline with `terms` added.

    `near`: another fit whose values are the starting point.  `start`: starting values by name; releases and impacts are
    then guessed anew.  `beside`: starting values by name; releases and impacts of `near` are kept.  `local`: starting
    values (R, L) of the local unknowns.  `use`: mask (N,) over rows.  `held`: values by name that are kept fixed.
    `most`: largest number of steps.  `rounds`: largest number of updates of the scatter.
    """
    unknowns = tuple(bench.unknowns(terms))
    fixed = dict(held or {})
    known = {} if near is None else by_name(near.unknowns, near.values)
    known |= {**(start or {}), **(beside or {}), **fixed}
    values = np.array([known.get(u.name, u.start) for u in unknowns])
    if local is None:
        local = near.local if near is not None and not start else bench.first_guess(by_name(unknowns, values))
    scatter = near.scatter if near is not None else bench.scatter_start
    jittered = any(term.geometry == "jitter" for term in terms)
    state = State(local.copy(), values, scatter.copy(), near.jitter if near is not None and jittered else 0.0)
    free = np.array([u.name not in fixed for u in unknowns], dtype=bool)
    mask = np.ones(len(bench.rows), dtype=bool) if use is None else use
    if jittered and state.jitter == 0.0:
        state.jitter = next(term.parameters[0].typical for term in terms if term.geometry == "jitter")
    odd = any(term.geometry == "scatter" for term in terms)
    most_scatter = np.full(len(state.scatter), np.inf) if odd else np.minimum(bench.scatter_most, WIDEST)
    converged, same = False, True
    if near is None or start:
        for horizon in getattr(bench, "horizons", list)():
            early = linearise(bench, terms, unknowns, state, mask & horizon)
            descend(bench, terms, unknowns, state, mask & horizon, free, early, most)
    linear = linearise(bench, terms, unknowns, state, mask)
    for number in range(rounds):
        linear, converged = descend(bench, terms, unknowns, state, mask, free, linear, most)
        if number == 0 and (stuck := _stuck(bench, state, linear)).any():
            guess = bench.first_guess(by_name(unknowns, state.values))
            other = replace(state, local=np.where(stuck[:, None], guess, state.local))
            anew = linearise(bench, terms, unknowns, other, mask)
            anew, done = descend(bench, terms, unknowns, other, mask, free, anew, most)
            if anew.objective < linear.objective:
                state, linear, converged = other, anew, done
        before = state.scatter.copy(), state.jitter
        expect_scatter(bench, unknowns, state, free, linear, most_scatter)
        if jittered:
            state.jitter, state.jitter_std = jitter_of(bench, linear, mask)
        same = np.allclose(state.scatter, before[0], rtol=0.01) and math.isclose(state.jitter, before[1], rel_tol=0.01)
        linear = linearise(bench, terms, unknowns, state, mask)
        # the scatter of impacts is meaningless where the model does not fit at all
        if same or linear.chi2 > HOPELESS * bench.rows.size:
            break
    if not same:  # the unknowns of the last round belong to the scatter before it
        linear, converged = descend(bench, terms, unknowns, state, mask, free, linear, LAST)
    linear = _above_zero(bench, terms, unknowns, state, mask, linear)
    return _finished(bench, terms, unknowns, state, mask, free, linear, converged)


def by_name(unknowns: Sequence[Unknown], values: Array) -> dict[str, float]:
    """Values of the unknowns by their names."""
    return {unknown.name: float(value) for unknown, value in zip(unknowns, values, strict=True)}


def _stuck(bench: Bench, state: State, linear: Linear) -> Array:
    """Mask (R,) of repetitions at a limit of their own unknowns that fit far worse than most.

    A rebound whose speed has come down to its limit has no flight any more from which to learn a higher one.
    """
    off = np.array([float(np.mean(linear.residual[span] ** 2)) for span in bench.spans])
    return np.asarray((state.local <= bench.local_low).any(axis=1) & (off > FAR_OFF * np.median(off)))


def _above_zero(
    bench: Bench, terms: Sequence[Effect], unknowns: tuple[Unknown, ...], state: State, mask: Array, linear: Linear
) -> Linear:
    """The same fit with a positive sign for unknowns on whose sign the prediction does not depend."""
    even = {f"{term.name}.{term.parameters[0].name}" for term in terms if term.even}
    below = [k for k, unknown in enumerate(unknowns) if unknown.name in even and state.values[k] < 0]
    if not below:
        return linear
    state.values[below] *= -1.0
    return linearise(bench, terms, unknowns, state, mask)


def screen(bench: Bench, near: Fit, candidates: Sequence[Effect]) -> list[Fit]:
    """Estimate the fit with each candidate added to `near`, by one Newton step for all of them.

    Exact where the gain is small.  What the same step promises without any candidate, as where `near` is not at its
    minimum, does not count.  The scatter between impacts is kept, so the gain is not overestimated.
    """
    joint = _Joint(bench, near, [term for term in candidates if not term.flat and term.geometry != "jitter"])
    shared = max(0.0, joint.gain(()))
    found = []
    for term in candidates:
        one = joint.with_terms((term,)) if term in joint.candidates else _glance(bench, (*near.terms, term), near)
        found.append(one if term.geometry == "jitter" else replace(one, deviance=one.deviance + shared))
    return found


def screen_pairs(bench: Bench, near: Fit, candidates: Sequence[Effect], most: int) -> list[tuple[Effect, Effect]]:
    """The pairs of candidates of different families that one Newton step promises most of, over the better one alone.

    Only pairs that together promise more than twice as much as the better one are returned, at most `most`.
    """
    joint = _Joint(bench, near, [term for term in candidates if not term.flat and term.geometry not in WIDENING])
    shared = max(0.0, joint.gain(()))
    alone = {term.name: joint.gain((term,)) - shared for term in joint.candidates}
    found = []
    for one, other in itertools.combinations(joint.candidates, 2):
        if one.group != other.group:
            better = max(alone[one.name], alone[other.name], 0.0)
            together = joint.gain((one, other)) - shared
            if together > 2 * better:
                found.append((together, one, other))
    found.sort(key=lambda pair: -pair[0])
    return [(one, other) for _, one, other in found[:most]]


class _Joint:
    """One linearisation at `near` with all candidates, from which Newton steps with some of them follow."""

    def __init__(self, bench: Bench, near: Fit, candidates: Sequence[Effect]) -> None:
        self.bench, self.near, self.candidates = bench, near, tuple(candidates)
        every = tuple(bench.unknowns((*near.terms, *candidates)))
        known = by_name(near.unknowns, near.values)
        self.values = np.array([known.get(u.name, u.start) for u in every])
        state = State(near.local.copy(), self.values, near.scatter.copy(), near.jitter)
        linear = linearise(bench, (*near.terms, *candidates), every, state, np.ones(len(bench.rows), dtype=bool))
        ab = np.linalg.solve(linear.a, linear.b)
        self.information = linear.c.sum(0) - np.einsum("rlg,rlh->gh", linear.b, ab)
        self.scores = linear.g_global - np.einsum("rlg,rl->rg", ab, linear.g_local)
        self.place = {u.name: k for k, u in enumerate(every)}

    def gain(self, more: Sequence[Effect]) -> float:
        """Promised decrease of the deviance."""
        return self.near.deviance - self.with_terms(more).deviance

    def with_terms(self, more: Sequence[Effect]) -> Fit:
        near = self.near
        terms = (*near.terms, *more)
        unknowns = tuple(self.bench.unknowns(terms))
        at = [self.place[u.name] for u in unknowns]
        values = self.values[at]
        tie = np.array([1 / u.sd**2 for u in unknowns])
        block = self.information[np.ix_(at, at)] + np.diag(tie)
        pull = self.scores[:, at].sum(0) + tie * (np.array([u.prior for u in unknowns]) - values)
        scale = np.sqrt(np.maximum(np.diag(block), NOTHING))
        inverse = np.linalg.inv(block / np.outer(scale, scale) + 1e-12 * np.eye(len(at))) / np.outer(scale, scale)
        # without its prior a calibration quantity has no penalty for its distance from the stated value
        lifted = sum(near.pulls.get(u.name, 0.0) ** 2 for u in unknowns if math.isinf(u.sd))
        return replace(
            near, terms=terms, unknowns=unknowns, values=values + inverse @ pull, covariance=inverse,
            robust=_robust(self.scores[:, at], inverse, tie),
            deviance=near.deviance - lifted - float(pull @ inverse @ pull),
        )  # fmt: skip


def _robust(scores: Array, inverse: Array, tie: Array) -> Array:
    """Robust (sandwich) standard deviations from the scatter of the scores between repetitions and priors (`tie`)."""
    repetitions = len(scores)
    centred = scores - scores.mean(0)
    meat = centred.T @ centred * repetitions / max(repetitions - 1, 1)
    return np.asarray(np.sqrt(np.maximum(np.diag(inverse @ (meat + np.diag(tie)) @ inverse), 0.0)))


def _glance(bench: Bench, terms: Sequence[Effect], near: Fit) -> Fit:
    """As `screen`, for one effect whose derivative vanishes at zero, or that only widens the noise."""
    unknowns = tuple(bench.unknowns(terms))
    known = {unknown.name: value for unknown, value in zip(near.unknowns, near.values, strict=True)}
    flat = {f"{term.name}.{term.parameters[0].name}" for term in terms if term.flat}
    # an effect whose derivative vanishes at zero is evaluated at a small value
    values = np.array([known.get(u.name, 0.5 * u.step if u.name in flat else u.start) for u in unknowns])
    state = State(near.local.copy(), values, near.scatter.copy(), near.jitter)
    mask, free = np.ones(len(bench.rows), dtype=bool), np.ones(len(unknowns), dtype=bool)
    linear = linearise(bench, terms, unknowns, state, mask)
    gain = 0.0
    if any(term.geometry == "jitter" for term in terms) and near.jitter == 0.0:
        state.jitter, state.jitter_std = jitter_of(bench, linear, mask)
        sigma = noise(bench, linear.seen, state.jitter)
        off = (bench.rows - linear.seen.position) ** 2
        plain = bench.sigma[:, None] ** 2 + 0 * off
        gain = float(np.sum(off / plain + np.log(plain)) - np.sum(off / sigma**2 + np.log(sigma**2)))
        step = np.zeros(len(unknowns))
    else:
        step_local, step = newton_step(unknowns, state, free, linear, 0.0)
        gain = near.objective - linear.objective + promised(unknowns, state, linear, step_local, step)
    glanced = _finished(bench, terms, unknowns, state, mask, free, linear, True)
    return replace(glanced, values=values + step, deviance=near.deviance - gain)


@np.errstate(all="ignore")  # a model without a finite prediction has an infinite deviance
def _finished(
    bench: Bench,
    terms: Sequence[Effect],
    unknowns: tuple[Unknown, ...],
    state: State,
    mask: Array,
    free: Array,
    linear: Linear,
    converged: bool,
) -> Fit:
    ab = np.linalg.solve(linear.a, linear.b)
    information = linear.c.sum(0) - np.einsum("rlg,rlh->gh", linear.b, ab)
    # score of each repetition, its local unknowns eliminated
    scores = linear.g_global - np.einsum("rlg,rl->rg", ab, linear.g_local)
    for k, unknown in enumerate(unknowns):
        information[k, k] += 1 / unknown.sd**2
    at = np.flatnonzero(free)
    covariance = np.zeros((len(unknowns), len(unknowns)))
    robust = np.zeros(len(unknowns))
    if len(at):
        scale = np.sqrt(np.maximum(np.diag(information)[at], NOTHING))
        block = information[np.ix_(at, at)] / np.outer(scale, scale) + 1e-12 * np.eye(len(at))
        inverse = np.linalg.inv(block) / np.outer(scale, scale)
        covariance[np.ix_(at, at)] = inverse
        robust[at] = _robust(scores[:, at], inverse, np.array([1 / unknowns[k].sd ** 2 for k in at]))
    tied = np.zeros_like(linear.a)
    diagonal = np.arange(tied.shape[1])
    tied[:, diagonal, diagonal] = 1.0 / bench.local_sd**2
    leverage = float(np.trace(np.linalg.solve(linear.a, linear.a - tied), axis1=1, axis2=2).sum()) + len(at)
    by_run = _by_run(bench, state, mask, linear)
    stated = sum(((v - u.prior) / u.sd) ** 2 for u, v in zip(unknowns, state.values, strict=True))
    deviance = float(by_run.sum()) + stated
    deviance = deviance if math.isfinite(deviance) else math.inf
    pulls = {
        u.name: (float(v) - u.prior) / u.sd
        for u, v in zip(unknowns, state.values, strict=True)
        if math.isfinite(u.sd) and u.sd > 0
    }
    return Fit(
        tuple(terms),
        unknowns,
        state.values.copy(),
        state.local.copy(),
        state.scatter.copy(),
        state.jitter,
        covariance,
        robust,
        deviance,
        linear.chi2,
        linear.objective,
        pulls,
        linear.residual,
        linear.seen.speed,
        linear.seen.position,
        converged,
        linear.soft,
        _whiteness(bench, linear.residual),
        leverage,
        state.jitter_std,
        int(np.sum(bench.scatter == len(state.scatter) - 1)),
        by_run,
        _frame(bench),
    )


def _frame(bench: Bench) -> float:
    """Median time step [s] between rows."""
    steps = np.diff(bench.time)
    return float(np.median(steps[steps > 0])) if np.any(steps > 0) else math.nan


def _by_run(bench: Bench, state: State, mask: Array, linear: Linear) -> Array:
    """(R,): -2 log of the likelihood of each repetition, its random effects integrated out."""
    square = np.sum(linear.residual**2, axis=1)
    if state.jitter > 0:
        sigma = noise(bench, linear.seen, state.jitter)
        wider = np.log(sigma / bench.sigma[:, None]).sum(axis=1) * (1 if sigma.shape[1] == 2 else 2)
        square = square + 2 * np.where(mask, wider, 0.0)
    found = np.array([float(square[span].sum()) for span in bench.spans])
    seen = bench.scatter >= 0
    if seen.size:
        spread = spread_of_each(bench, state.scatter)
        found += np.sum((linear.soft / spread) ** 2 + 2 * np.log(np.where(seen, spread, 1.0)), axis=1)
    found += np.sum(((state.local - bench.local_prior) / bench.local_sd) ** 2, axis=1)
    return np.asarray(found + np.linalg.slogdet(linear.a)[1])


def _whiteness(bench: Bench, residual: Array) -> float:
    body = getattr(bench, "body", np.zeros(len(residual), dtype=int))
    # differences only within one bead and one repetition
    follows = (bench.owner[1:] == bench.owner[:-1]) & (body[1:] == body[:-1])
    change = (residual[1:] - residual[:-1])[follows]
    return float(np.mean(change**2) / max(2 * np.mean(residual**2), 1e-300)) if follows.any() else 1.0
