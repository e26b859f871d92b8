"""Motion of the beads that stream from a slot, by cross-correlation; gravity makes it a clock in the picture.

Between two frames the pattern at one height moves down by a shift, which is larger further down.  The correlations of
all pairs of frames are summed for every height before the usual shift is read (ensemble correlation, see `piv`).  This
works even if the frame rate is too low to follow single beads.  In free fall the square of the speed increases
linearly: v^2 = v0^2 + 2 g y.  Beads pass a given height always about as fast, so a step in which all of them move twice
as far means that a frame is missing.
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

FINE = 12.0  # [px], bead diameter in the picture that is correlated; a finer one gives no better result
WINDOW = 1.5  # [bead diameters], height of the pattern that is searched in the next frame
APART = 0.5  # [bead diameters], distance of neighbouring heights
BEADS = 3.0  # least standard deviation of a pattern over the noise
FEWEST_PAIRS = 5  # least number of pairs of frames at one height
FEWEST_ROWS = 4  # least number of heights for a fall
STANDS_OUT = 0.25  # least height of a correlation peak above the median: shifts of other beads reach half of that
AS_ALIKE = 0.8  # least peak over that of the best height: it is lower where beads land or still push each other
# relative standard uncertainty of the acceleration: beads of a dense stream still touch, collide and drag air along
NOT_FREE = 0.1
# least number of heights that show the step of two frames: windows overlap, and so many are independent
ROWS = 3
SURE = 0.4  # least mean correlation of a step
AS_GOOD = 0.05  # correlation below that of the best step within which a smaller step is preferred
STILL = 0.35  # [usual steps], below which nothing falls: what lies or stands there correlates without a shift
PACES = np.arange(0.0, 4.01, 0.1)  # [frames], tried as the time between two pictures


@dataclass(frozen=True)
class Usual:
    """Shift of the beads between two regular frames, by height."""

    row: npt.NDArray[np.intp]  # [px] below the slot, where the shift begins
    shift: Array  # [px]
    acceleration: float  # [px/frame^2]
    uncertainty: float  # relative standard uncertainty of the acceleration

    def after(self, frames: Array) -> Array:
        """Distance that beads move within so many frames [px], shape (rows, frames)."""
        drawn_apart = self.acceleration * (frames**2 - frames) / 2
        return np.asarray(self.shift[:, None] * frames + drawn_apart)


class Stream:
    """What falls below a slot, in pairs of neighbouring frames."""

    def __init__(self, bead: float, noise: float) -> None:
        """`bead` is a diameter [px], `noise` in grey levels."""
        self._zoom = min(1.0, FINE / bead)
        self._bead = bead * self._zoom
        self._high = max(round(WINDOW * self._bead), 6)
        self._least = BEADS * noise
        # correlation by shift, of every row; half precision, because a long film has thousands of pairs
        self._pairs: list[dict[int, npt.NDArray[np.float16]]] = []
        # sums and numbers of pairs over the steady flow
        self._sums: defaultdict[int, Array] = defaultdict(lambda: np.zeros(1))
        self._counts: Counter[int] = Counter()

    def add(self, before: GreyImage, after: GreyImage, *, steady: bool) -> None:
        """Add the previous and the current frame, as differences from the empty hopper from the slot downwards.

        `steady`: whether beads flow steadily and no frame is missing between the two.
        """
        before, after = self._smaller(before), self._smaller(after)
        height, reach = before.shape
        pair: dict[int, npt.NDArray[np.float16]] = {}
        for row in np.arange(BEGINS * self._bead, height - self._high - 3, APART * self._bead).astype(int).tolist():
            sought = before[row : row + self._high]
            if float(sought.std()) > self._least:
                # beads that fall further than the slot's width between two frames separate too much to be recognised
                where = after[row : row + self._high + reach]
                alike = cv2.matchTemplate(where, sought, cv2.TM_CCOEFF_NORMED)
                pair[row] = np.asarray(alike[:, 0], dtype=np.float16)
                if steady:
                    self._sums[row] = self._sums[row] + alike[:, 0]
                    self._counts[row] += 1
        self._pairs.append(pair)

    def fall(self, interval: float) -> FreeFall | None:
        """Acceleration [px/s^2] for frames `interval` [s] apart; None if too little is seen."""
        usual = self._usual
        if usual is None:
            return None
        acceleration = usual.acceleration / self._zoom / interval**2
        return FreeFall(acceleration, acceleration * math.hypot(usual.uncertainty, NOT_FREE))

    def frames_between(self) -> Array:
        """Number of usual steps from each picture to the next, shape (pairs,); NaN if too few beads are seen.

        Of equally good steps the smallest is taken.  Beads nearer to each other than their shift cannot be
        distinguished, so the true step may be larger.
        """
        usual = self._usual
        if usual is None:
            return np.full(len(self._pairs), math.nan)
        way = usual.after(PACES)
        return np.array([_frames(pair, usual.row, way) for pair in self._pairs])

    @cached_property
    def _usual(self) -> Usual | None:
        """Usual shift over all pairs; read it only after the last pair was added."""
        from scipy.stats import theilslopes

        means = {row: self._sums[row] / count for row, count in self._counts.items() if count >= FEWEST_PAIRS}
        peaks = {row: peak for row, mean in sorted(means.items()) if (peak := _peak(mean)) is not None}
        best = max((alike for _, alike in peaks.values()), default=0.0)
        seen = np.array([(row, shift) for row, (shift, alike) in peaks.items() if alike > AS_ALIKE * best])
        if len(seen) < FEWEST_ROWS:
            return None
        row, shift = seen.T
        halfway = row + shift / 2
        # median of all slopes: robust against heights at which other beads were matched
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
    """Shift [px] and height of a correlation's peak; None if no peak stands out or nothing moves."""
    peak = int(np.argmax(mean))
    if not 0 < peak < len(mean) - 1 or mean[peak] < np.median(mean) + STANDS_OUT:
        return None
    return peak + vertex(mean[peak - 1 : peak + 2]), float(mean[peak])


def _frames(pair: dict[int, npt.NDArray[np.float16]], rows: npt.NDArray[np.intp], way: Array) -> float:
    """The smallest of `PACES` at whose shifts `way`, shape (rows, paces) [px], the rows of a pair correlate."""
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
