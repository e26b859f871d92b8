"""How beads that stream from a slot move on their way down: a clock in the picture, for gravity is known.

Between two frames what is at one height moves down by a shift, by a larger one the lower it is.  The correlations of
all pairs of frames are summed for every height before the usual shift is read (ensemble correlation, see `piv`): so it
is seen where frames are too few to follow one bead.  Along free fall its square grows evenly: v^2 = v0^2 + 2 g y.
Beads pass a height always about as fast: where all of them move twice as far between two frames, one is missing there.
"""

from __future__ import annotations

import math
from collections import Counter, defaultdict
from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
import numpy.typing as npt

from rigtwin.lab.arrays import Array, GreyImage
from rigtwin.measure.bulk.piv import vertex
from rigtwin.measure.hopper.free_fall_clock import BEGINS, LEAST_FALL, FreeFall

FINE = 12.0  # [px], a bead's diameter in the picture that is correlated: finer ones tell no more
WINDOW = 1.5  # bead diameters, height of what is sought in the next frame
APART = 0.5  # bead diameters between two heights
BEADS = 3.0  # times the noise, standard deviation of a window that shows beads
FEWEST_PAIRS = 5  # of frames at one height
FEWEST_ROWS = 4  # heights that show a fall
STANDS_OUT = 0.25  # of a correlation, by which its peak must stand out: shifts of other beads reach half of that
AS_ALIKE = 0.8  # of the best height's correlation: where beads land, or still push each other, frames are less alike
# relative, of its acceleration: beads of a dense stream still touch, hit each other and drag air along
NOT_FREE = 0.1
# heights that must show two frames' step: windows overlap so that this many are all different
ROWS = 3
SURE = 0.4  # mean correlation of a step that is believed
AS_GOOD = 0.05  # below that of the best step, up to which a smaller one may be meant as well
STILL = 0.35  # usual steps, below which nothing falls: what lies there, or is in front, looks alike without a step
PACES = np.arange(0.0, 4.01, 0.1)  # frames between two pictures that are tried


@dataclass(frozen=True)
class Usual:
    """The step that beads take between two usual frames."""

    row: npt.NDArray[np.intp]  # [px] below the slot, where it begins
    shift: Array  # [px]
    acceleration: float  # [px/frame^2]
    doubt: float  # relative, of that

    def after(self, frames: Array) -> Array:
        """[px], how far beads go within so many frames, shape (rows, frames)."""
        drawn_apart = self.acceleration * (frames**2 - frames) / 2
        return np.asarray(self.shift[:, None] * frames + drawn_apart)


class Stream:
    """What falls below a slot, seen in pairs of neighbouring frames."""

    def __init__(self, bead: float, noise: float) -> None:
        """`bead` [px] is a diameter, `noise` [grey levels]."""
        self._zoom = min(1.0, FINE / bead)
        self._bead = bead * self._zoom
        self._high = max(round(WINDOW * self._bead), 6)
        self._least = BEADS * noise
        # correlation by shift, of every row; as halves, for a long film has thousands of pairs
        self._pairs: list[dict[int, npt.NDArray[np.float16]]] = []
        # the same, sums and numbers of pairs, over the steady flow
        self._sums: defaultdict[int, Array] = defaultdict(lambda: np.zeros(1))
        self._counts: Counter[int] = Counter()

    def add(self, before: GreyImage, after: GreyImage, *, steady: bool) -> None:
        """The next frame and the one before: how much pixels from the slot on downwards differ from the empty hopper.

        `steady`: whether beads flow steadily and no time is missing between the two.
        """
        before, after = self._smaller(before), self._smaller(after)
        height, reach = before.shape
        pair: dict[int, npt.NDArray[np.float16]] = {}
        for row in np.arange(BEGINS * self._bead, height - self._high - 3, APART * self._bead).astype(int).tolist():
            sought = before[row : row + self._high]
            if float(sought.std()) > self._least:
                # beads that fall by more than the slot's width between two frames are too much torn apart to be known
                where = after[row : row + self._high + reach]
                alike = cv2.matchTemplate(where, sought, cv2.TM_CCOEFF_NORMED)
                pair[row] = np.asarray(alike[:, 0], dtype=np.float16)
                if steady:
                    self._sums[row] = self._sums[row] + alike[:, 0]
                    self._counts[row] += 1
        self._pairs.append(pair)

    def fall(self, interval: float) -> FreeFall | None:
        """The acceleration [px/s^2] of frames `interval` [s] apart, None where too little is seen of it."""
        usual = self._usual
        if usual is None:
            return None
        acceleration = usual.acceleration / self._zoom / interval**2
        return FreeFall(acceleration, acceleration * math.hypot(usual.doubt, NOT_FREE))

    def frames_between(self) -> Array:
        """How many usual steps beads take from each picture to the next; NaN where too few are seen.

        Of those that fit alike the least: beads nearer to each other than they move look as if they had moved less.
        """
        usual = self._usual
        if usual is None:
            return np.full(len(self._pairs), math.nan)
        way = usual.after(PACES)
        return np.array([_frames(pair, usual.row, way) for pair in self._pairs])

    @cached_property
    def _usual(self) -> Usual | None:
        """Of all pairs: to be asked for when the last one is added."""
        from scipy.stats import theilslopes

        means = {row: self._sums[row] / count for row, count in self._counts.items() if count >= FEWEST_PAIRS}
        peaks = {row: peak for row, mean in sorted(means.items()) if (peak := _peak(mean)) is not None}
        best = max((alike for _, alike in peaks.values()), default=0.0)
        seen = np.array([(row, shift) for row, (shift, alike) in peaks.items() if alike > AS_ALIKE * best])
        if len(seen) < FEWEST_ROWS:
            return None
        row, shift = seen.T
        halfway = row + shift / 2
        # a height at which other beads were matched must not bend the line: median of all slopes
        slope, _, low, high = theilslopes(shift**2, halfway, 0.68)
        if np.ptp(halfway) < LEAST_FALL * self._bead or low <= 0:
            return None
        return Usual(row.astype(int), shift, float(slope) / 2, float((high - low) / 2 / slope))

    def _smaller(self, picture: GreyImage) -> GreyImage:
        if self._zoom == 1:
            return picture
        height, width = (max(round(self._zoom * side), 1) for side in picture.shape)
        small = cv2.resize(picture, (width, height), interpolation=cv2.INTER_AREA)
        return np.asarray(small, dtype=np.uint8)


def _peak(mean: Array) -> tuple[float, float] | None:
    """Shift [px] and height of a correlation's peak, None where none stands out or nothing moves."""
    peak = int(np.argmax(mean))
    if not 0 < peak < len(mean) - 1 or mean[peak] < np.median(mean) + STANDS_OUT:
        return None
    return peak + vertex(mean[peak - 1 : peak + 2]), float(mean[peak])


def _frames(pair: dict[int, npt.NDArray[np.float16]], rows: npt.NDArray[np.intp], way: Array) -> float:
    """The fewest of `PACES` over whose way, [px] of shape (rows, paces), a pair's rows are alike."""
    curves = [
        np.interp(at, np.arange(len(pair[row])), pair[row], right=math.nan)
        for row, at in zip(rows.tolist(), way, strict=True)
        if row in pair
    ]
    if len(curves) < ROWS:
        return math.nan
    count = np.isfinite(curves).sum(axis=0)
    alike = np.where(count >= max(ROWS, len(curves) / 2), np.nansum(curves, axis=0) / np.maximum(count, 1), -1.0)
    best = float(np.max(alike))
    if best < SURE:
        return math.nan
    falling = (PACES > STILL) | (PACES[int(np.argmax(alike))] < STILL)
    first = int(np.argmax((alike > best - AS_GOOD) & falling))
    top = int(np.argmax(np.append(np.diff(alike[first:]) <= 0, True)))
    return float(PACES[first + top])
