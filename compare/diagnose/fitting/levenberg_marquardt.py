"""Levenberg-Marquardt descent with the local unknowns of each repetition eliminated."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from rigtwin.compare.diagnose.fitting.normal_equations import Bench, Linear, State, linearise
from rigtwin.compare.diagnose.models.unknown import Unknown
from rigtwin.lab.arrays import Array, Mask
from rigtwin.sim.effects import Effect

FAR = 3.0  # objective per coordinate above which a model fits badly
HOPELESS = 100.0  # objective per coordinate above which a model does not fit at all
NEGLIGIBLE = 1e-2  # gain that changes no decision
LEFT, LEFT_HOPELESS = 1e-4, 5e-3
"""Share of the objective beyond one per coordinate to which a model is fitted, and the same for one that does not fit.
What is compared with a bad model differs from it by far more; independent labs keep their verdicts."""
IDLE = 4
"""Steps without gain, and none with a gain between them, that end the descent; integration in steps makes the objective
slightly rough."""
DAMPED, FREE = 1e-4, 1e-9
"""Relative damping at the start for a bad model, and at the end.  The final value is small because the information that
separates two interchangeable calibration quantities is a millionth of the information on either."""
NOTHING = 1e-120  # floor of the information on an unknown, avoids division by zero


def descend(
    bench: Bench,
    terms: Sequence[Effect],
    unknowns: Sequence[Unknown],
    state: State,
    mask: Array,
    free: Array,
    linear: Linear,
    most: int,
) -> tuple[Linear, bool]:
    """Levenberg-Marquardt descent at fixed scatter; changes `state`.  Returns last point and whether it converged."""
    refused, idle = False, 0
    damping = DAMPED if linear.objective > FAR * bench.rows.size else FREE
    low, high = np.array([u.low for u in unknowns]), np.array([u.high for u in unknowns])
    for _ in range(most):
        step_local, step_global = _step_within(bench.local_low, low, high, unknowns, state, free, linear, damping)
        trial = State(
            np.maximum(state.local + step_local, bench.local_low),
            np.clip(state.values + step_global, low, high),
            state.scatter,
            state.jitter,
        )
        tried = linearise(bench, terms, unknowns, trial, mask)
        gain = linear.objective - tried.objective
        small = _small(min(tried.objective, linear.objective), bench.rows.size)
        # where the objective is slightly rough a step that promises nothing may fail by more than it promised
        promise = promised(unknowns, state, linear, step_local, step_global)
        if abs(gain) < small or (gain < 0 and promise < small):
            idle += 1
        elif gain > 0:  # a step that went too far says nothing of what the next ones gain
            idle = 0
        if gain >= 0:
            state.local, state.values, linear = trial.local, trial.values, tried
            # with less damping a step that was just refused would be refused again
            damping = damping if refused else max(damping / 10, FREE)
            if idle >= IDLE or (idle and damping <= FREE):
                return linear, True
            if idle and not refused:
                damping = FREE
            refused = False
        else:
            if idle >= IDLE or (gain > -NEGLIGIBLE and damping <= DAMPED):
                return linear, True
            damping, refused = damping * (10 if damping >= DAMPED else 100), True
            if damping > (1e8 if linear.objective < HOPELESS * bench.rows.size else 1.0):
                return linear, True
    return linear, False


def _small(objective: float, rows: int) -> float:
    """Gain that is not worth a step."""
    share = LEFT if objective < HOPELESS * rows else LEFT_HOPELESS
    return NEGLIGIBLE + share * max(objective - rows, 0.0)


def promised(unknowns: Sequence[Unknown], state: State, linear: Linear, step_local: Array, step_global: Array) -> float:
    """Decrease of the objective by a step in the linearised model."""
    return float(np.sum(linear.g_local * step_local) + np.sum(_gradient(unknowns, state, linear) * step_global))


def _gradient(unknowns: Sequence[Unknown], state: State, linear: Linear) -> Array:
    """Half the downward gradient (G,) of the objective by the global unknowns, with their priors."""
    pull = np.array([(u.prior - v) / u.sd**2 for u, v in zip(unknowns, state.values, strict=True)])
    return np.asarray(linear.g_global.sum(0) + pull)


def _step_within(
    local_low: Array,
    low: Array,
    high: Array,
    unknowns: Sequence[Unknown],
    state: State,
    free: Array,
    linear: Linear,
    damping: float,
) -> tuple[Array, Array]:
    """Newton step without the unknowns at a limit that the gradient, or else the step itself, leads across it.

    The step alone does not show which unknowns belong at their limit: it may lead one across only because it leads
    others across theirs.
    """

    def across(local: Array, values: Array) -> tuple[Mask, Mask]:
        """Which unknowns at a limit a change of all would lead across it."""
        beyond = ((state.values <= low) & (values < 0)) | ((state.values >= high) & (values > 0))
        return (state.local <= local_low) & (local < 0), beyond

    def step_without(held_local: Mask, held: Mask) -> tuple[Array, Array]:
        without = _holding(linear, held_local) if held_local.any() else linear
        return newton_step(unknowns, state, np.logical_and(free, ~held), without, damping)

    held_local, held = across(linear.g_local, _gradient(unknowns, state, linear))
    step = step_without(held_local, held)
    over_local, over = across(*step)
    if over_local.any() or over.any():
        step = step_without(held_local | over_local, held | over)
    return step


def _holding(linear: Linear, held: Mask) -> Linear:
    """The equations without the local unknowns marked in `held` (R, L): their steps are zero."""
    a, b = np.where(held[:, :, None] | held[:, None], 0.0, linear.a), np.where(held[..., None], 0.0, linear.b)
    run, at = np.nonzero(held)
    a[run, at, at] = 1.0
    return replace(linear, a=a, b=b, g_local=np.where(held, 0.0, linear.g_local))


def newton_step(
    unknowns: Sequence[Unknown], state: State, free: Array, linear: Linear, damping: float
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
