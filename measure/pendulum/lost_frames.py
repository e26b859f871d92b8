"""Detect lost or doubled frames that the time stamps do not show, from the phase of the swing.

After such a frame both beads are ahead of, or behind, their swings by a whole number of frames.  A lens, the pull of
a thread or a wrong length distort the whole swing; no other cause gives a phase step at one frame, except that a long
contact delays the beads.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from rigtwin.lab.arrays import Array
from rigtwin.lab.errors import NothingToMeasure
from rigtwin.lab.records import Track
from rigtwin.measure.media.frame_loss import MOST, OUTLIER, Loss, in_time
from rigtwin.measure.pendulum.swing_fit import SwingFit, correlation, frame_interval, misses_of, slopes_of
from rigtwin.measure.pendulum.swing_model import angles, positions

Fit = Callable[[tuple[Track, ...]], SwingFit]

CLEAR = 4.5  # standard uncertainties by which a step must differ from zero
LEAST = 0.5  # [frames], minimum step: codec and camera shake cause fractions of a frame
EXPLAINED = 0.5  # minimum share of a step's sum of squares that must vanish after the correction by whole frames
FRACTION = 0.3  # [frames], largest step that may remain after the correction

UNSEEN = 1e-6  # lower limit of the share of a step that the parameters of the swing do not absorb


@dataclass(frozen=True)
class _Step:
    """Phase step of the beads at one frame."""

    time: float  # [s], of that frame
    frames: float  # positive: the beads are ahead
    sigma: float  # [frames], standard uncertainty
    share: float  # share of the residual sum of squares that it explains

    @property
    def clear(self) -> bool:
        return abs(self.frames) > CLEAR * self.sigma

    @property
    def broken(self) -> bool:
        """Whether it is clearly no whole number of frames."""
        return self.clear and abs(self.frames - round(self.frames)) > FRACTION


def find_losses(times: Array, tracks: Sequence[Track], fit: Fit) -> tuple[tuple[Loss, ...], SwingFit]:
    """Lost frames as indices into the `times` [s] of all frames, and the swings with the certain ones corrected.

    The search ends at the first loss that is not certain.
    """
    losses: list[Loss] = []
    fitted = fit(tuple(tracks))
    step = _step(fitted)
    while step.clear and abs(step.frames) > LEAST:
        moved, frames = in_time(times, losses), round(step.frames)
        index = int(np.searchsorted(moved, step.time))
        loss = Loss(index, frames, float(times[index]), frames * frame_interval(fitted.tracks[0]), at_contact=False)
        try:
            mended, better = _mended(times, tracks, fit, [*losses, loss])
        except NothingToMeasure:  # no swing fits these times
            losses.append(replace(loss, sure=False))
            break
        left = _step(better)
        gone = better.noise < fitted.noise * math.sqrt(1 - EXPLAINED * step.share) and not left.broken
        # a long contact looks like a frame that is shown twice
        sure = gone and len(losses) < MOST and (frames > 0 or not mended.at_contact)
        losses.append(replace(mended, sure=sure))
        if not sure:
            break
        fitted, step = better, left
    return tuple(losses), fitted


def at_times(times: Array, tracks: Sequence[Track], losses: Sequence[Loss]) -> tuple[Track, ...]:
    """The tracks with their times, a subset of `times` [s], corrected for the certain losses."""
    moved = in_time(times, losses)
    return tuple(replace(track, time=moved[np.searchsorted(times, track.time)]) for track in tracks)


def _step(fit: SwingFit) -> _Step:
    """The phase step that explains most of the residuals.

    A step is tried at every frame: its pattern is projected off the parameters of the swing, and the residuals are
    projected on it.
    """
    interval = frame_interval(fit.tracks[0])
    slopes = slopes_of(fit)
    ways, _ = np.linalg.qr(slopes / np.linalg.norm(slopes, axis=0))
    left = misses_of(fit)
    left -= ways @ (ways.T @ left)
    ahead = misses_of(fit, -interval / 2) - misses_of(fit, interval / 2)  # one frame
    own = [np.tile(track.time[mask], 2) for track, mask in zip(fit.tracks, fit.used, strict=True)]
    time = np.concatenate([*own, np.full(len(left) - sum(map(len, own)), -np.inf)])
    order = np.argsort(-time, kind="stable")
    since, first = time[order], np.unique(-time[order], return_index=True)[1]
    # sums over all points from a frame on
    along, size = np.cumsum((ahead * left)[order]), np.cumsum((ahead**2)[order])
    taken = np.cumsum(ahead[order, None] * ways[order], axis=0)
    last = np.append(first[1:], len(since))[:-2] - 1  # no step before the first frame or at the priors
    seen = np.maximum(size[last] - np.sum(taken[last] ** 2, axis=1), UNSEEN * size[last])
    gains = along[last] ** 2 / seen
    best = int(np.argmax(gains))
    end, frames = last[best], float(along[last[best]] / seen[best])
    after = left - frames * (ahead * (time >= since[end]) - ways @ taken[end])
    count = len(own[0])
    together = correlation(after[:count].reshape(2, -1))
    return _Step(
        float(since[end]),
        frames,
        math.sqrt(together * float(np.mean(after**2)) / seen[best]),
        float(gains[best] / np.sum(left**2)),
    )


def _mended(times: Array, tracks: Sequence[Track], fit: Fit, losses: list[Loss]) -> tuple[Loss, SwingFit]:
    """The last loss moved to its most likely frame, and the swings with all losses corrected."""
    fitted = fit(at_times(times, tracks, losses))
    best = _placed(times, tracks, fitted, losses)
    if best.index != losses[-1].index:
        fitted = fit(at_times(times, tracks, [*losses[:-1], best]))
    return best, fitted


def _placed(times: Array, tracks: Sequence[Track], fit: SwingFit, losses: Sequence[Loss]) -> Loss:
    """The last loss at the frame for which the corrected points fit the swings best."""
    loss, before = losses[-1], in_time(times, losses[:-1])
    off = np.zeros((2, len(times)))
    for bead, track in enumerate(tracks):
        known = np.searchsorted(times, track.time)
        for side, shift in enumerate((0.0, loss.shift)):
            at = positions(fit.swings, angles(fit.swings, before[known] + shift)[0])[bead, :, 0]
            off[side, known] += np.minimum(np.sum((track.position - at) ** 2, axis=1) / fit.noise**2, OUTLIER**2)
    total = np.cumsum(off[0])[:-1] + np.cumsum(off[1][::-1])[::-1][1:]
    index = int(np.argmin(total)) + 1
    hit = float(fit.swings["time_0"])
    near = before[index - 1] - abs(loss.shift) < hit < before[index] + 2 * abs(loss.shift)
    return replace(loss, index=index, time=float(times[index]), at_contact=bool(near))
