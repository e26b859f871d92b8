"""Particle image velocimetry: displacements of a texture by cross-correlation of small windows.

The correlation maps of all pairs of frames are summed before the peak search (ensemble correlation, Meinhart et al.
2000), so that random peaks average out.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from rigtwin.lab.arrays import Array, GreyImage

FLAT = 1.0  # [grey levels], minimum standard deviation of a window with texture


@dataclass(frozen=True)
class Displacements:
    """Mean displacement between consecutive frames at n places."""

    place: Array  # [px], shape (n, 2), centres of the windows, x right, y down
    shift: Array  # [px], shape (n, 2); NaN without texture or peak
    score: Array  # [1], shape (n,), mean correlation at the peak, 1 is perfect
    pairs: npt.NDArray[np.int64]  # shape (n,), number of frame pairs averaged


class MeanCorrelation:
    """Sum of the correlation maps of frame pairs; `displacements` returns the mean displacement.

    >>> import numpy as np
    >>> texture = np.random.default_rng(0).integers(0, 255, (60, 60)).astype(np.uint8)
    >>> mean = MeanCorrelation(np.array([[30.0, 30.0]]), window=16, reach=(6, 6))
    >>> mean.add(texture, np.roll(texture, (3, -2), axis=(0, 1)))
    >>> np.round(mean.displacements().shift[0]).tolist()
    [-2.0, 3.0]
    """

    def __init__(self, place: Array, *, window: int, reach: tuple[int, int]) -> None:
        """`place` are the centres of the windows [px], shape (n, 2); `reach` is the largest shift in x and y [px]."""
        self.place = np.asarray(place, dtype=np.float64).reshape(-1, 2)
        self._window = window
        self._reach = reach
        self._sum = np.zeros((len(self.place), 2 * reach[1] + 1, 2 * reach[0] + 1))
        self._pairs = np.zeros(len(self.place), dtype=np.int64)

    def add(self, one: GreyImage, other: GreyImage) -> None:
        """Add the correlation of two consecutive frames."""
        across, down = self._reach
        for k, (x, y) in enumerate(self.place):
            left, top = round(x - self._window / 2), round(y - self._window / 2)
            right, bottom = left + self._window, top + self._window
            if left < across or top < down or right + across > one.shape[1] or bottom + down > one.shape[0]:
                continue
            template = one[top:bottom, left:right]
            if float(template.std()) < FLAT:
                continue
            searched = other[top - down : bottom + down, left - across : right + across]
            self._sum[k] += cv2.matchTemplate(searched, template, cv2.TM_CCOEFF_NORMED)
            self._pairs[k] += 1

    def displacements(self) -> Displacements:
        """Sub-pixel peak of every summed correlation map."""
        shift = np.full((len(self.place), 2), np.nan)
        score = np.zeros(len(self.place))
        for k, (total, pairs) in enumerate(zip(self._sum, self._pairs, strict=True)):
            if pairs == 0:
                continue
            row, column = np.unravel_index(int(np.argmax(total)), total.shape)
            score[k] = float(total[row, column]) / pairs
            if 0 < row < total.shape[0] - 1 and 0 < column < total.shape[1] - 1:
                shift[k, 0] = column + vertex(total[row, column - 1 : column + 2]) - self._reach[0]
                shift[k, 1] = row + vertex(total[row - 1 : row + 2, column]) - self._reach[1]
        return Displacements(self.place, shift, score, self._pairs.copy())


def without_outliers(found: Displacements, *, lowest_score: float = 0.2) -> Displacements:
    """The displacements with outliers set to NaN.

    Normalised median test (Westerweel and Scarano 2005) over the four nearest places.
    """
    shift = found.shift.copy()
    shift[found.score < lowest_score] = np.nan
    kept = shift.copy()
    for k in range(len(shift)):
        away = np.hypot(*(found.place - found.place[k]).T)
        near = [n for n in np.argsort(away)[1:5] if np.isfinite(shift[n]).all()]
        if len(near) < 3:
            continue
        middle = np.median(shift[near], axis=0)
        scatter = np.median(np.abs(shift[near] - middle), axis=0)
        if np.any(np.abs(shift[k] - middle) > 4 * (scatter + 0.3)):
            kept[k] = np.nan
    return Displacements(found.place, kept, found.score, found.pairs)


def vertex(three: Array) -> float:
    """Position of the maximum of the parabola through three values, relative to the middle one."""
    bend = three[0] - 2 * three[1] + three[2]
    return float(0.5 * (three[0] - three[2]) / bend) if bend < 0 else 0.0
