"""Frames that a film lost, or shows twice, without its times saying so: found by the phase of the swing.

From there on both beads are ahead of their swings, or behind them, by a whole number of frames.  A lens, a thread's
pull or a wrong length bend the whole of a swing; nothing else puts it ahead from one frame on, also at a collision:
a contact that lasts holds the beads up.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from rigtwin.lab.arrays import Array
from rigtwin.lab.errors import NothingToMeasure
from rigtwin.lab.records import Track
from rigtwin.measure.media.frame_loss import MOST, WILD, Loss, in_time
from rigtwin.measure.pendulum.swing_fit import SwingFit, correlation, frame_interval, misses_of, slopes_of
from rigtwin.measure.pendulum.swing_model import angles, positions

Fit = Callable[[tuple[Track, ...]], SwingFit]

CLEAR = 4.5  # standard uncertainties of a step, by which it must differ from none
LEAST = 0.5  # frames, of a step: what a codec or a shake does to a swing looks like a fraction of one
EXPLAINED = 0.5  # of the squares that a step explains, that are to be gone once whole frames are put right
FRACTION = 0.3  # of a frame, that they may leave of it

UNSEEN = 1e-6  # of a step's squares, which are left of it where the swings' own numbers do the same


@dataclass(frozen=True)
class _Step:
    """By how much the beads are ahead of their swings from one frame on."""

    time: float  # [s], of that frame
    frames: float
    doubt: float  # one standard uncertainty of the frames
    share: float  # of the squares left, that it explains

    @property
    def clear(self) -> bool:
        return abs(self.frames) > CLEAR * self.doubt

    @property
    def broken(self) -> bool:
        """Whether it is no whole number of frames."""
        return self.clear and abs(self.frames - round(self.frames)) > FRACTION


def find_losses(times: Array, tracks: Sequence[Track], fit: Fit) -> tuple[tuple[Loss, ...], SwingFit]:
    """Where frames are lost, as indices into the `times` [s] of all frames, and the swings with those that are sure.

    One that is not sure is the last.
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
        except NothingToMeasure:  # not with such times
            losses.append(replace(loss, sure=False))
            break
        left = _step(better)
        gone = better.noise < fitted.noise * math.sqrt(1 - EXPLAINED * step.share) and not left.broken
        # a contact that lasts looks like a frame that is shown twice
        sure = gone and len(losses) < MOST and (frames > 0 or not mended.at_contact)
        losses.append(replace(mended, sure=sure))
        if not sure:
            break
        fitted, step = better, left
    return tuple(losses), fitted


def at_times(times: Array, tracks: Sequence[Track], losses: Sequence[Loss]) -> tuple[Track, ...]:
    """The tracks, whose points are at some of the `times`, with the sure losses put right."""
    moved = in_time(times, losses)
    return tuple(replace(track, time=moved[np.searchsorted(times, track.time)]) for track in tracks)


def _step(fit: SwingFit) -> _Step:
    """The step of the phase that explains most of what the fit leaves.

    Of every frame by itself: what is left of a step there, once the swings are fitted anew, and how much of what is
    left of the points lies along it.
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
    # of all points from a frame on, each the sum of those after it
    along, size = np.cumsum((ahead * left)[order]), np.cumsum((ahead**2)[order])
    taken = np.cumsum(ahead[order, None] * ways[order], axis=0)
    last = np.append(first[1:], len(since))[:-2] - 1  # no step before the first frame, nor at what is known beforehand
    seen = np.maximum(size[last] - np.sum(taken[last] ** 2, axis=1), UNSEEN * size[last])
    gains = along[last] ** 2 / seen
    best = int(np.argmax(gains))
    end, frames = last[best], float(along[last[best]] / seen[best])
    after = left - frames * (ahead * (time >= since[end]) - ways @ taken[end])
    count = len(own[0])
    together = correlation([after[:count].reshape(2, -1).T], [np.ones(count // 2, dtype=bool)])
    return _Step(
        float(since[end]),
        frames,
        math.sqrt(together * float(np.mean(after**2)) / seen[best]),
        float(gains[best] / np.sum(left**2)),
    )


def _mended(times: Array, tracks: Sequence[Track], fit: Fit, losses: list[Loss]) -> tuple[Loss, SwingFit]:
    """The last loss, moved to where the points then follow the swings, and the swings with all put right."""
    fitted = fit(at_times(times, tracks, losses))
    best = _placed(times, tracks, fitted, losses)
    if best.index != losses[-1].index:
        fitted = fit(at_times(times, tracks, [*losses[:-1], best]))
    return best, fitted


def _placed(times: Array, tracks: Sequence[Track], fit: SwingFit, losses: Sequence[Loss]) -> Loss:
    """The last loss at the frame from which on the points lie on the swings as they are then."""
    loss, before = losses[-1], in_time(times, losses[:-1])
    off = np.zeros((2, len(times)))
    for bead, track in enumerate(tracks):
        known = np.searchsorted(times, track.time)
        for side, shift in enumerate((0.0, loss.shift)):
            at = positions(fit.swings, angles(fit.swings, before[known] + shift)[0])[bead, :, 0]
            off[side, known] += np.minimum(np.sum((track.position - at) ** 2, axis=1) / fit.noise**2, WILD**2)
    total = np.cumsum(off[0])[:-1] + np.cumsum(off[1][::-1])[::-1][1:]
    index = int(np.argmin(total)) + 1
    hit = float(fit.swings["time_0"])
    near = before[index - 1] - abs(loss.shift) < hit < before[index] + 2 * abs(loss.shift)
    return replace(loss, index=index, time=float(times[index]), at_contact=bool(near))
