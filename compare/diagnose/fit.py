"""Nested least squares: a rig's global unknowns together with the random start and impacts of every repetition.

The local unknowns of a repetition touch only its own data, so they are eliminated block by block (Schur complement).
Scatter between impacts is a random effect: its standard deviation is estimated by expectation-maximisation, and the
deviance integrates the local unknowns out (Laplace).  What the experimenter states with an uncertainty (scale, clock,
roll, level, length) is an unknown with that prior: an effect may not take credit for it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Protocol

import numpy as np

from rigtwin.compare.diagnose.slopes import Moving, Slopes, slopes
from rigtwin.compare.diagnose.unknowns import Unknown
from rigtwin.lab.records import Array
from rigtwin.sim.effects import Effect

FAR, FAR_WORTH = 3.0, 3e-5  # squared deviation per coordinate beyond which a model is no description
HOPELESS, HOPELESS_WORTH = 100.0, 5e-3
NOTHING = 1e-120  # information on an unknown of which the data say nothing
LEAST_SCATTER = 1e-3  # of a restitution or a rebound direction: smaller is not believed
BLOCK = 128  # rows
LEAST_TOLD = 0.2  # share of the deviations that the data determine, at least, in one step of the scatter


class Bench(Moving, Protocol):
    """A rig with its data, as the fit sees it."""

    sigma: Array  # [m], (N,)
    local_prior: Array  # (R, L)
    local_sd: Array  # (R, L)
    scatter: Array  # (R, S) index of the scatter that a soft row belongs to, -1 where there is none
    scatter_start: Array  # (H,)
    scatter_most: Array  # (H,), what the scatter of an ordinary lab stays below
    condition: Array  # (R,) number of the condition of each repetition

    def unknowns(self, terms: Sequence[Effect]) -> list[Unknown]: ...

    def first_guess(self, values: Mapping[str, float]) -> Array: ...


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
    """Squared differences of the residuals from row to row over twice their squares: 1 for noise that is white."""
    leverage: float = 0.0
    """How many of the deviations the unknowns take up."""
    jitter_std: float = math.nan  # [s]
    kicks: int = 0
    """Impacts that the last of `scatter` speaks of."""
    by_run: Array = field(default_factory=lambda: np.zeros(0))
    """(R,), each repetition's share of the deviance; the priors of the global unknowns are the rest of it."""

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

    def index(self, name: str) -> int:
        return [unknown.name for unknown in self.unknowns].index(name)

    def of(self, effect: str) -> list[Unknown]:
        return [unknown for unknown in self.unknowns if unknown.effect == effect]


@dataclass
class _State:
    local: Array
    values: Array
    scatter: Array
    jitter: float
    jitter_std: float = math.nan


@dataclass
class _Linear:
    """Everything at one point: the objective and its normal equations."""

    objective: float
    chi2: float
    seen: Slopes
    residual: Array
    a: Array  # (R, L, L)
    b: Array  # (R, L, G)
    c: Array  # (R, G, G)
    g_local: Array  # (R, L)
    g_global: Array  # (R, G)
    soft: Array  # (R, S)
    soft_slope: Array  # (R, S, L)


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

    `near` starts from another fit's values; `start` sets single unknowns and lets releases and impacts be guessed anew,
    `beside` sets them and keeps those of `near`; `use` is a mask over rows; `held` keeps the named unknowns at these
    values.
    """
    unknowns = tuple(bench.unknowns(terms))
    fixed = dict(held or {})
    values = np.array([unknown.start for unknown in unknowns])
    if near is not None:
        known = {unknown.name: value for unknown, value in zip(near.unknowns, near.values, strict=True)}
        values = np.array([known.get(u.name, u.start) for u in unknowns])
    for number, unknown in enumerate(unknowns):
        if start and unknown.name in start:
            values[number] = start[unknown.name]
        if beside and unknown.name in beside:
            values[number] = beside[unknown.name]
        if unknown.name in fixed:
            values[number] = fixed[unknown.name]
    if local is None:
        named = {u.name: float(v) for u, v in zip(unknowns, values, strict=True)}
        local = near.local if near is not None and not start else bench.first_guess(named)
    scatter = near.scatter if near is not None else bench.scatter_start
    jittered = any(term.geometry == "jitter" for term in terms)
    state = _State(local.copy(), values, scatter.copy(), near.jitter if near is not None and jittered else 0.0)
    free = np.array([u.name not in fixed for u in unknowns], dtype=bool)
    mask = np.ones(len(bench.rows), dtype=bool) if use is None else use
    if jittered and state.jitter == 0.0:
        state.jitter = next(term.parameters[0].typical for term in terms if term.geometry == "jitter")
    odd = any(term.geometry == "scatter" for term in terms)
    most_scatter = np.full(len(state.scatter), np.inf) if odd else bench.scatter_most
    converged = False
    if near is None or start:
        for horizon in getattr(bench, "horizons", list)():
            early = _linearise(bench, terms, unknowns, state, mask & horizon)
            _descend(bench, terms, unknowns, state, mask & horizon, free, early, most)
    linear = _linearise(bench, terms, unknowns, state, mask)
    for _ in range(rounds):
        linear, converged = _descend(bench, terms, unknowns, state, mask, free, linear, most)
        before = state.scatter.copy(), state.jitter
        _expect_scatter(bench, state, linear, most_scatter)
        if jittered:
            state.jitter, state.jitter_std = _jitter(bench, linear, mask)
        same = np.allclose(state.scatter, before[0], rtol=0.01) and math.isclose(state.jitter, before[1], rel_tol=0.01)
        linear = _linearise(bench, terms, unknowns, state, mask)
        # how impacts scatter is no question where nothing fits
        if same or linear.objective > HOPELESS * bench.rows.size:
            break
    return _finished(bench, terms, unknowns, state, mask, free, linear, converged)


def linear_at(
    bench: Bench, terms: Sequence[Effect], unknowns: Sequence[Unknown], local: Array, values: Array, scatter: Array
) -> _Linear:
    """The objective and its normal equations at given unknowns, on all rows."""
    state = _State(local, values, scatter, 0.0)
    return _linearise(bench, terms, unknowns, state, np.ones(len(bench.rows), dtype=bool))


def screen(bench: Bench, near: Fit, candidates: Sequence[Effect]) -> list[Fit]:
    """What the fit `near` would come to with each of the candidates added, by one Newton step for all of them.

    Exact where the gain is small.  The gain leaves the scatter between impacts as it was, so it is never promised too
    much.
    """
    smooth = [term for term in candidates if not term.flat and term.geometry != "jitter"]
    every = tuple(bench.unknowns((*near.terms, *smooth)))
    known = {unknown.name: float(value) for unknown, value in zip(near.unknowns, near.values, strict=True)}
    state = _State(
        near.local.copy(), np.array([known.get(u.name, u.start) for u in every]), near.scatter.copy(), near.jitter
    )
    linear = _linearise(bench, (*near.terms, *smooth), every, state, np.ones(len(bench.rows), dtype=bool))
    ab = np.linalg.solve(linear.a, linear.b)
    information = linear.c.sum(0) - np.einsum("rlg,rlh->gh", linear.b, ab)
    scores = linear.g_global - np.einsum("rlg,rl->rg", ab, linear.g_local)
    place = {u.name: k for k, u in enumerate(every)}
    found = []
    for term in candidates:
        if term not in smooth:
            found.append(_glance(bench, (*near.terms, term), near))
            continue
        terms = (*near.terms, term)
        unknowns = tuple(bench.unknowns(terms))
        at = [place[u.name] for u in unknowns]
        values = state.values[at]
        tie = np.array([1 / u.sd**2 for u in unknowns])
        block = information[np.ix_(at, at)] + np.diag(tie)
        pull = scores[:, at].sum(0) + tie * (np.array([u.prior for u in unknowns]) - values)
        scale = np.sqrt(np.maximum(np.diag(block), NOTHING))
        inverse = np.linalg.inv(block / np.outer(scale, scale) + 1e-12 * np.eye(len(at))) / np.outer(scale, scale)
        # a calibration quantity that is set free no longer pays for being far from what was stated
        lifted = sum(near.pulls.get(u.name, 0.0) ** 2 for u in unknowns if math.isinf(u.sd))
        found.append(
            replace(
                near, terms=terms, unknowns=unknowns, values=values + inverse @ pull, covariance=inverse,
                robust=_robust(scores[:, at], inverse, tie),
                deviance=near.deviance - lifted - float(pull @ inverse @ pull),
            )
        )  # fmt: skip
    return found


def _robust(scores: Array, inverse: Array, tie: Array) -> Array:
    """Standard deviations from the scatter of the scores between repetitions, and from what is stated (`tie`)."""
    repetitions = len(scores)
    centred = scores - scores.mean(0)
    meat = centred.T @ centred * repetitions / max(repetitions - 1, 1)
    return np.asarray(np.sqrt(np.maximum(np.diag(inverse @ (meat + np.diag(tie)) @ inverse), 0.0)))


def _glance(bench: Bench, terms: Sequence[Effect], near: Fit) -> Fit:
    """As `screen`, for one effect that has no slope at zero or that only widens the noise."""
    unknowns = tuple(bench.unknowns(terms))
    known = {unknown.name: value for unknown, value in zip(near.unknowns, near.values, strict=True)}
    flat = {f"{term.name}.{term.parameters[0].name}" for term in terms if term.flat}
    # an effect that has no slope at zero is looked at from a little beside it
    values = np.array([known.get(u.name, 0.5 * u.step if u.name in flat else u.start) for u in unknowns])
    state = _State(near.local.copy(), values, near.scatter.copy(), near.jitter)
    mask, free = np.ones(len(bench.rows), dtype=bool), np.ones(len(unknowns), dtype=bool)
    linear = _linearise(bench, terms, unknowns, state, mask)
    gain = 0.0
    if any(term.geometry == "jitter" for term in terms) and near.jitter == 0.0:
        state.jitter, state.jitter_std = _jitter(bench, linear, mask)
        sigma = _sigma(bench, linear.seen, state.jitter)
        off = (bench.rows - linear.seen.position) ** 2
        plain = bench.sigma[:, None] ** 2 + 0 * off
        gain = float(np.sum(off / plain + np.log(plain)) - np.sum(off / sigma**2 + np.log(sigma**2)))
        step = np.zeros(len(unknowns))
    else:
        step_local, step = _step(unknowns, state, free, linear, 0.0)
        pull = np.array([(u.prior - v) / u.sd**2 for u, v in zip(unknowns, values, strict=True)])
        beside = linear.objective - near.objective
        gain = -beside + float(np.sum(linear.g_local * step_local) + np.sum((linear.g_global.sum(0) + pull) * step))
    glanced = _finished(bench, terms, unknowns, state, mask, free, linear, True)
    return replace(glanced, values=values + step, deviance=near.deviance - gain)


@np.errstate(all="ignore")  # a step too far may overflow; it is then refused as one that fits infinitely badly
def _linearise(
    bench: Bench, terms: Sequence[Effect], unknowns: Sequence[Unknown], state: _State, mask: Array
) -> _Linear:
    """Residuals and normal equations at a state."""
    repetitions, size = state.local.shape
    count = len(unknowns)
    seen = slopes(bench, unknowns, terms, state.local, state.values)
    sigma = _sigma(bench, seen, state.jitter)
    weight = np.where(mask, 1.0, 0.0)[:, None] / sigma
    residual = (bench.rows - seen.position) * weight
    by_row = seen.by_row * weight
    spread = np.where(bench.scatter >= 0, state.scatter[np.maximum(bench.scatter, 0)], np.inf)
    soft = seen.soft
    whole = np.empty((repetitions, size + count, size + count))
    gradient = np.empty((repetitions, size + count))
    for r, span in enumerate(bench.spans):
        j = by_row[:, span].reshape(size + count, -1)
        whole[r] = _gram(j)
        gradient[r] = j @ residual[span].reshape(-1)
    scaled = np.moveaxis(seen.by_soft, 0, 1) / spread[:, None]  # (R, L + G, S)
    whole += scaled @ np.moveaxis(scaled, 1, 2)
    gradient -= (scaled @ (soft / spread)[..., None])[..., 0]
    tie = 1.0 / bench.local_sd**2
    index = np.arange(size)
    whole[:, index, index] += tie
    gradient[:, :size] += tie * (bench.local_prior - state.local)
    chi2 = float(np.sum(residual**2))
    objective = chi2 + float(np.sum((soft / spread) ** 2))
    objective += float(np.sum(tie * (state.local - bench.local_prior) ** 2))
    objective += sum(((v - u.prior) / u.sd) ** 2 for u, v in zip(unknowns, state.values, strict=True))
    if state.jitter > 0:
        objective += (
            2 * float(np.sum(np.log(sigma[mask] / bench.sigma[mask, None]))) * (1 if sigma.shape[1] == 2 else 2)
        )
    return _Linear(
        objective if math.isfinite(objective) and np.isfinite(whole).all() else math.inf,
        chi2,
        seen,
        residual,
        whole[:, :size, :size],
        whole[:, :size, size:],
        whole[:, size:, size:],
        gradient[:, :size],
        gradient[:, size:],
        soft,
        np.moveaxis(seen.by_soft[:size], 0, -1),
    )


def _gram(j: Array) -> Array:
    """j @ j.T, in blocks so small that the library starts no threads: those cost more than they bring here."""
    even = j.shape[1] // BLOCK * BLOCK
    blocks = j[:, :even].reshape(len(j), -1, BLOCK).swapaxes(0, 1)
    rest = j[:, even:]
    return np.asarray((blocks @ blocks.swapaxes(1, 2)).sum(0) + rest @ rest.T)


def _sigma(bench: Bench, seen: Slopes, jitter: float) -> Array:
    """[m], (N, 1) or (N, 2): the noise of each coordinate."""
    if jitter == 0.0:
        return bench.sigma[:, None]
    return np.sqrt(bench.sigma[:, None] ** 2 + (jitter * seen.speed) ** 2)


def _descend(
    bench: Bench,
    terms: Sequence[Effect],
    unknowns: Sequence[Unknown],
    state: _State,
    mask: Array,
    free: Array,
    linear: _Linear,
    most: int,
) -> tuple[_Linear, bool]:
    """Levenberg-Marquardt with the scatter held; changes `state`."""
    damping, refused = 1e-4, False
    small = 0
    low, high = np.array([u.low for u in unknowns]), np.array([u.high for u in unknowns])
    for _ in range(most):
        step_local, step_global = _step(unknowns, state, free, linear, damping)
        trial = _State(
            state.local + step_local,
            np.clip(state.values + step_global, low, high),
            state.scatter,
            state.jitter,
        )
        tried = _linearise(bench, terms, unknowns, trial, mask)
        if tried.objective <= linear.objective:
            gain = linear.objective - tried.objective
            state.local, state.values, linear = trial.local, trial.values, tried
            # a step just refused at less damping would be refused again
            damping = damping if refused else max(damping / 10, 1e-9)
            refused = False
            worth = _worth(tried.objective / bench.rows.size)
            small = small + 1 if gain < 1e-2 + worth * abs(tried.objective) else 0
            if small >= 1 and damping < 1e-2:
                return linear, True
        else:
            if tried.objective - linear.objective < 1e-2 and damping < 1e-2:
                return linear, True
            damping, refused = damping * 10, True
            if damping > (1e8 if linear.objective < HOPELESS * bench.rows.size else 1.0):
                return linear, True
    return linear, False


def _worth(per_row: float) -> float:
    """The relative gain for which another step is worth while: how badly a model fails is of no use to the digit."""
    return HOPELESS_WORTH if per_row > HOPELESS else FAR_WORTH if per_row > FAR else 1e-7


def _step(
    unknowns: Sequence[Unknown], state: _State, free: Array, linear: _Linear, damping: float
) -> tuple[Array, Array]:
    a = linear.a.copy()
    diagonal = np.arange(a.shape[1])
    a[:, diagonal, diagonal] *= 1 + damping
    reduced = np.linalg.solve(a, np.concatenate([linear.b, linear.g_local[..., None]], axis=2))
    ab, ag = reduced[..., :-1], reduced[..., -1]
    s = linear.c.sum(0) - np.einsum("rlg,rlh->gh", linear.b, ab)
    g = linear.g_global.sum(0) - np.einsum("rlg,rl->g", linear.b, ag)
    for k, (unknown, value) in enumerate(zip(unknowns, state.values, strict=True)):
        s[k, k] += 1 / unknown.sd**2
        g[k] += (unknown.prior - value) / unknown.sd**2
    at = np.flatnonzero(free)
    step = np.zeros(len(unknowns))
    if len(at):
        block = s[np.ix_(at, at)]
        scale = np.sqrt(np.maximum(np.diag(block), NOTHING))
        block = block / np.outer(scale, scale) + (1e-12 + damping) * np.eye(len(at))
        step[at] = np.linalg.solve(block, g[at] / scale) / scale
    return ag - ab @ step, step


def _expect_scatter(bench: Bench, state: _State, linear: _Linear, most: Array) -> None:
    """Squared deviations over as many of them as the data determine (MacKay 1992).

    The fixed point is that of expectation-maximisation, which takes dozens of steps to a small scatter.
    """
    if not len(state.scatter):
        return
    inverse = np.linalg.inv(linear.a)
    variance = np.einsum("rsi,rij,rsj->rs", linear.soft_slope, inverse, linear.soft_slope)
    for h in range(len(state.scatter)):
        mine = bench.scatter == h
        if mine.any():
            told = 1.0 - np.minimum(variance[mine] / state.scatter[h] ** 2, 1.0)
            square = float(np.sum(linear.soft[mine] ** 2) / max(float(np.sum(told)), LEAST_TOLD * told.size))
            state.scatter[h] = max(min(math.sqrt(square), float(most[h])), LEAST_SCATTER)


def _jitter(bench: Bench, linear: _Linear, mask: Any) -> tuple[float, float]:
    """[s], the timestamp jitter that makes the residuals along the path most likely, and its standard deviation.

    Differences from row to row: jitter differs from frame to frame, a misfit of the model hardly does.  The noise of a
    bead at rest is fitted along with it: what was found from the tracks themselves holds part of the jitter.
    """
    from scipy.optimize import minimize

    residual = bench.rows - linear.seen.position
    follows = mask[1:] & mask[:-1] & (np.abs(np.diff(bench.time)) < 3 * np.median(np.abs(np.diff(bench.time))))
    off = np.diff(residual, axis=0)[follows] ** 2 / 2
    squared = linear.seen.speed**2
    speed, floor = (squared[1:] + squared[:-1])[follows] / 2, bench.sigma[1:][follows, None] ** 2

    def badness(logs: Array) -> float:
        variance = math.exp(2 * logs[1]) * floor + math.exp(2 * logs[0]) * speed
        return float(np.sum(off / variance + np.log(variance)))

    limits = [(math.log(1e-7), math.log(0.05)), (math.log(0.3), math.log(1.05))]
    starts = [(math.log(tau), 0.0) for tau in (1e-5, 1e-3)]
    found = min(
        (minimize(badness, start, method="L-BFGS-B", bounds=limits) for start in starts), key=lambda one: one.fun
    )
    h = 0.02
    bend = np.array(
        [
            [
                badness(found.x + h * (i + j)) - badness(found.x + h * (i - j)) - badness(found.x - h * (i - j))
                + badness(found.x - h * (i + j))
                for j in np.eye(2)
            ]
            for i in np.eye(2)
        ]
    ) / (8 * h * h)  # fmt: skip
    # half of the badness is the log of the likelihood; neighbouring differences share a row
    variance = np.linalg.pinv(bend)[0, 0] * 1.5
    tau = math.exp(float(found.x[0]))
    return tau, tau * math.sqrt(max(float(variance), 0.0))


def _finished(
    bench: Bench,
    terms: Sequence[Effect],
    unknowns: tuple[Unknown, ...],
    state: _State,
    mask: Array,
    free: Array,
    linear: _Linear,
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
        _whiteness(linear.residual, getattr(bench, "bodies", 1)),
        leverage,
        state.jitter_std,
        int(np.sum(bench.scatter == len(state.scatter) - 1)),
        by_run,
    )


def _by_run(bench: Bench, state: _State, mask: Array, linear: _Linear) -> Array:
    """(R,): -2 log of the likelihood of each repetition, its random effects integrated out."""
    square = np.sum(linear.residual**2, axis=1)
    if state.jitter > 0:
        sigma = _sigma(bench, linear.seen, state.jitter)
        wider = np.log(sigma / bench.sigma[:, None]).sum(axis=1) * (1 if sigma.shape[1] == 2 else 2)
        square = square + 2 * np.where(mask, wider, 0.0)
    found = np.array([float(square[span].sum()) for span in bench.spans])
    seen = bench.scatter >= 0
    if seen.size:
        spread = np.where(seen, state.scatter[np.maximum(bench.scatter, 0)], np.inf)
        found += np.sum((linear.soft / spread) ** 2 + 2 * np.log(np.where(seen, spread, 1.0)), axis=1)
    found += np.sum(((state.local - bench.local_prior) / bench.local_sd) ** 2, axis=1)
    return np.asarray(found + np.linalg.slogdet(linear.a)[1])


def _whiteness(residual: Array, bodies: int) -> float:
    change = residual[bodies:] - residual[:-bodies]
    return float(np.sum(change**2) / max(2 * np.sum(residual**2), 1e-300))
