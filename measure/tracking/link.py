"""Link the moving spots of successive frames into paths."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import islice

import numpy as np
from scipy.optimize import linear_sum_assignment

from rigtwin.lab.arrays import Array
from rigtwin.lab.errors import Mark
from rigtwin.measure.tracking.detect import Spot

Where = Callable[[int], tuple[tuple[float, float], tuple[float, float]]]
"""Centre [px] and motion [px/frame] of a bead by frame index."""

MOST_MARKED = 8  # paths drawn into the picture of a refusal


@dataclass(frozen=True)
class SpotPath:
    """Spots of one moving object, frame by frame."""

    frames: tuple[int, ...]
    spots: tuple[Spot, ...]

    @cached_property
    def centres(self) -> Array:
        """Centres of the spots [px], shape (n, 2)."""
        return np.array([(spot.x, spot.y) for spot in self.spots])

    @cached_property
    def radius(self) -> float:
        """[px], half the narrower side of the spots, median over the path; motion blur widens only the other side."""
        return float(np.median([min(spot.width, spot.height) for spot in self.spots])) / 2


def place_on(path: SpotPath) -> Where:
    """Centre and motion per frame from the spots; linear interpolation across gaps, at rest before and after."""
    frames = np.array(path.frames, dtype=np.float64)
    centres = path.centres

    def where(frame: int) -> tuple[tuple[float, float], tuple[float, float]]:
        x, y = (float(np.interp(frame, frames, centres[:, k])) for k in (0, 1))
        k = int(np.clip(np.searchsorted(frames, frame), 1, len(frames) - 2))
        if frame < frames[0] or frame > frames[-1]:
            return (x, y), (0.0, 0.0)
        ahead = (centres[k + 1] - centres[k]) / (frames[k + 1] - frames[k])
        behind = (centres[k] - centres[k - 1]) / (frames[k] - frames[k - 1])
        # at a bounce the two have opposite signs; use half of the longer one
        step = (ahead + behind) / 2 if np.dot(ahead, behind) > 0 else max(ahead, behind, key=np.linalg.norm) / 2
        return (x, y), (float(step[0]), float(step[1]))

    return where


def path_marks(paths: Iterable[tuple[Sequence[int], Iterable[Array]]]) -> tuple[Mark, ...]:
    """The first paths, of frames and places [px], as lines in the picture, with the frames that they last."""
    return tuple(
        Mark(f"{frames[0]}-{frames[-1]}", [(float(x), float(y)) for x, y in places])
        for frames, places in islice(paths, MOST_MARKED)
    )


class Linker:
    """Links spots of successive frames into paths; a path may have gaps.

    The assignment of spots to paths minimises the total cost (Hungarian algorithm).
    """

    patience = 25  # frames without a spot after which a path ends

    def __init__(self) -> None:
        self._open: list[_Thread] = []
        self._closed: list[_Thread] = []

    def add(self, frame: int, spots: Sequence[Spot]) -> None:
        """Add the spots of the next frame."""
        cost = np.array([[thread.cost(frame, spot) for spot in spots] for thread in self._open]).reshape(
            len(self._open), len(spots)
        )
        used = set()
        if cost.size:
            for row, column in zip(*linear_sum_assignment(np.minimum(cost, 1e6)), strict=True):
                if cost[row, column] < 1e6:
                    self._open[int(row)].append(frame, spots[int(column)])
                    used.add(int(column))
        self._open += [_Thread(frame, spot) for k, spot in enumerate(spots) if k not in used]
        stale = [thread for thread in self._open if frame - thread.frames[-1] > self.patience]
        self._closed += [thread for thread in stale if len(thread.frames) > 3]
        self._open = [thread for thread in self._open if frame - thread.frames[-1] <= self.patience]

    def paths(self) -> list[SpotPath]:
        """All paths of more than three frames."""
        threads = self._closed + [thread for thread in self._open if len(thread.frames) > 3]
        return [SpotPath(tuple(thread.frames), tuple(thread.spots)) for thread in threads]


class _Thread:
    def __init__(self, frame: int, spot: Spot) -> None:
        self.frames = [frame]
        self.spots = [spot]
        self.velocity = 0.0, 0.0  # [px/frame]

    def append(self, frame: int, spot: Spot) -> None:
        last, gap = self.spots[-1], frame - self.frames[-1]
        self.velocity = (spot.x - last.x) / gap, (spot.y - last.y) / gap
        self.frames.append(frame)
        self.spots.append(spot)

    def cost(self, frame: int, spot: Spot) -> float:
        """Normalised distance to the predicted position (free flight or bounce) plus dissimilarity; inf: impossible."""
        last, gap = self.spots[-1], frame - self.frames[-1]
        size = math.sqrt(last.area) + 2
        x, y = spot.x - last.x, spot.y - last.y
        u, v = self.velocity
        reach = (1.4 * math.hypot(u, v) + 1.2 * size) * gap if len(self.frames) > 1 else 4 * size * gap
        # specks of noise must not be linked to a bead; an area ratio up to six occurs when a shadow merges with a bead
        if math.hypot(x, y) > reach or abs(math.log(spot.area / last.area)) > math.log(6):
            return math.inf
        flying = math.hypot(x - u * gap, y - v * gap)
        bounced = math.hypot(x - u * gap, y + 0.5 * v * gap)
        likeness = abs(math.log(spot.area / last.area)) + abs(math.log(spot.contrast / last.contrast))
        return min(flying, 1.3 * bounced + 0.3 * size) / size + 0.7 * likeness
