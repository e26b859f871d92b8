"""Direction of rotation of a drum from the beads along its wall, and checks that the picture is upright.

The wall carries beads to the top of the slope, so the surface rises in the direction in which they move.  A bed lies
below the axis of the drum, displaced to one side by its angle of repose.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from rigtwin.lab.arrays import Array, FloatImage, Image
from rigtwin.lab.quantity import Check
from rigtwin.measure.drum.rim import Rim
from rigtwin.measure.geometry.lines import fullest_run

RING = (0.72, 0.9)  # shares of the radius: beads carried by the wall, away from its edge and from a flange
FINEST = (
    120  # largest number of steps per radius: beads are several steps wide, and the rings of all frames are in memory
)
WIDEST_STEP = 0.25  # largest rotation between two pictures, as a share of the bed's sector
NARROWEST = math.radians(40)  # least sector with enough beads at the wall
LAGS = (1, 2, 4, 8, 16)  # frames, tried until the rotation exceeds the noise
LEAST_STEP = 2  # [steps of the ring], at which smaller shifts are evaluated: there the correlation falls steeply
MOST_PAIRS = 60
FEWEST_PAIRS = 6
CLEAR = 0.02  # least difference of the sum of two correlations that is motion, however small its standard error
SURE = 5.0  # standard errors by which the correlation in one direction must exceed that in the other
# [deg], between the bed's middle and straight below the axis; this is the angle of repose, up to 60 and more for sticky
# powders
LARGEST_BED_DIRECTION = 75.0


@dataclass(frozen=True)
class Sector:
    """Part of the ring along the drum's wall that is deep in the bed: picture coordinates of its pixels."""

    x: FloatImage  # [px], shape (radii, angles); angles increase clockwise
    y: FloatImage

    def seen(self, grey: Image) -> Image:
        return np.asarray(cv2.remap(grey, self.x, self.y, cv2.INTER_LINEAR), dtype=np.uint8)


def sector_of(before: FloatImage, rim: Rim) -> Sector | None:
    """The bed's sector at the wall, from the log odds of the mean bed; None if too little of it is seen."""
    step = max(1.0, rim.radius / FINEST)  # [px]
    radii = np.arange(RING[0] * rim.radius, RING[1] * rim.radius, step)
    middle = float(np.mean(RING)) * rim.radius / step
    count = round(2 * math.pi * middle)
    angles = np.arange(count) / middle
    x = (rim.centre[0] + radii[:, None] * np.cos(angles)).astype(np.float32)
    y = (rim.centre[1] + radii[:, None] * np.sin(angles)).astype(np.float32)
    odds = cv2.remap(before, x, y, cv2.INTER_LINEAR, borderValue=-3.0)
    first, length = _longest_run_around(np.asarray((odds > 0).mean(axis=0) > 0.6))
    first, length = first + length // 8, length - 2 * (length // 8)  # away from the surface at both ends
    if length < NARROWEST * middle or len(radii) < 4:
        return None
    columns = (first + np.arange(length)) % count
    return Sector(np.ascontiguousarray(x[:, columns]), np.ascontiguousarray(y[:, columns]))


def _longest_run_around(marked: npt.NDArray[np.bool_]) -> tuple[int, int]:
    """Start and length of the longest marked stretch of a circle."""
    if marked.all():
        return 0, len(marked)
    start = int(np.argmin(marked))  # not marked, so no run crosses the end of the array
    run = fullest_run(np.roll(marked, -start), gap=1)
    return (0, 0) if run is None else ((start + run[0]) % len(marked), run[1] - run[0] + 1)


def turning_of(rings: Sequence[Image]) -> int:
    """Direction of rotation in the picture: +1 clockwise, -1 anticlockwise, 0 unknown.

    `rings` are the pixels of a sector in every frame.  Static dirt and reflections are subtracted first.  Each pair is
    correlated in both time orders: flicker and jitter look the same in both, rotation does not.
    """
    if len(rings) <= FEWEST_PAIRS:
        return 0
    still = np.mean(rings, axis=0, dtype=np.float32)
    reach = int(WIDEST_STEP * still.shape[1])
    for lag in LAGS:
        if len(rings) - lag < FEWEST_PAIRS:
            break
        firsts = np.unique(np.linspace(0, len(rings) - lag - 1, MOST_PAIRS).round().astype(int))
        pairs = [(rings[k] - still, rings[k + lag] - still) for k in firsts]
        # correlation by the clockwise shift of the later picture; the reversed pair has the opposite shift
        alike = np.array([_likeness(one, other, reach) + _likeness(other, one, reach)[::-1] for one, other in pairs])
        moved = max(abs(int(np.argmax(alike.mean(axis=0))) - reach), LEAST_STEP)
        onward = alike[:, reach + moved] - alike[:, reach - moved]
        mean, error = float(onward.mean()), float(onward.std(ddof=1)) / math.sqrt(len(onward))
        if abs(mean) > max(CLEAR, SURE * error):
            return 1 if mean > 0 else -1
    return 0


def _likeness(earlier: FloatImage, later: FloatImage, reach: int) -> Array:
    """Correlation of the later picture with the middle of the earlier one, for shifts from -reach to +reach."""
    middle = earlier[:, reach : earlier.shape[1] - reach]
    return np.asarray(cv2.matchTemplate(later, middle, cv2.TM_CCOEFF_NORMED)[0], dtype=np.float64)


def stance_checks(bed_direction: float, turning: int, rises: float) -> list[Check]:
    """Check that the picture is upright, and that the surface rises in the direction of the beads at the wall.

    `bed_direction` is the direction of the bed's middle from the drum's axis [rad], 0 straight below it; `rises` is +1
    where the surface rises to the right, -1 to the left.
    """
    checks = []
    if math.isfinite(bed_direction):
        degrees = math.degrees(abs(bed_direction))
        passed = degrees < LARGEST_BED_DIRECTION
        ending = (
            "." if passed else ": too far for a flowing bed; the picture lies on its side, or --camera-roll is wrong."
        )
        message = f"the bed's middle lies {degrees:.0f} degrees to one side of straight below the drum's axis{ending}"
        checks.append(Check("bed_below", passed, degrees, 0.0, message))
    if turning:
        way, side = "clockwise" if turning > 0 else "anticlockwise", "right" if rises > 0 else "left"
        passed = turning * rises < 0
        message = f"the beads at the wall go {way}, {'and' if passed else 'but'} the surface rises to the {side}"
        ending = "." if passed else ": the picture lies on its side, or the film runs backwards."
        checks.append(Check("turning", passed, float(turning), -rises, message + ending))
    return checks
