"""Which way a drum turns, by the beads along its wall, and where its bed lies: what shows a picture on its side.

Beads at the wall are carried by it until they are at the top of the slope, so that the surface rises the way in which
they go; and a bed lies below the drum's axis, to one side by its angle of repose.
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

RING = (0.72, 0.9)  # of the radius: beads that the wall carries, clear of its edge and of a flange
FINEST = 120  # steps of the ring to a radius: beads are several wide, and a long film's rings are kept in memory
WIDEST_STEP = 0.25  # of the bed's sector, that it may turn by between two pictures
NARROWEST = math.radians(40)  # sector without which too few beads are seen at the wall
LAGS = (1, 2, 4, 8, 16)  # frames, until the bed has turned by enough to be told from noise
LEAST_STEP = 2  # steps of the ring, at which a shift by less is looked for: there the likeness falls steeply
MOST_PAIRS = 60
FEWEST_PAIRS = 6
CLEAR = 0.02  # of a sum of two correlations: less is no motion, however sure
SURE = 5.0  # standard errors by which the likeness one way has to exceed that the other way
# [deg], that a bed lies aside of the axis: by its angle of repose, and sticky powders reach 60 and more
MOST_ASIDE = 75.0


@dataclass(frozen=True)
class Sector:
    """A stretch of the ring along the drum's wall that is deep in the bed: where its pixels lie in the picture."""

    x: FloatImage  # [px], shape (radii, angles); angles rise clockwise
    y: FloatImage

    def seen(self, grey: Image) -> Image:
        return np.asarray(cv2.remap(grey, self.x, self.y, cv2.INTER_LINEAR), dtype=np.uint8)


def sector_of(before: FloatImage, rim: Rim) -> Sector | None:
    """The bed's sector at the wall, by the log odds of the mean bed; None where too little of it is seen."""
    step = max(1.0, rim.radius / FINEST)  # [px]
    radii = np.arange(RING[0] * rim.radius, RING[1] * rim.radius, step)
    middle = float(np.mean(RING)) * rim.radius / step
    count = round(2 * math.pi * middle)
    angles = np.arange(count) / middle
    x = (rim.centre[0] + radii[:, None] * np.cos(angles)).astype(np.float32)
    y = (rim.centre[1] + radii[:, None] * np.sin(angles)).astype(np.float32)
    odds = cv2.remap(before, x, y, cv2.INTER_LINEAR, borderValue=-3.0)
    first, length = _longest_run_around(np.asarray((odds > 0).mean(axis=0) > 0.6))
    first, length = first + length // 8, length - 2 * (length // 8)  # clear of the surface at both ends
    if length < NARROWEST * middle or len(radii) < 4:
        return None
    columns = (first + np.arange(length)) % count
    return Sector(np.ascontiguousarray(x[:, columns]), np.ascontiguousarray(y[:, columns]))


def _longest_run_around(marked: npt.NDArray[np.bool_]) -> tuple[int, int]:
    """Start and length of the longest marked stretch of a circle."""
    if marked.all():
        return 0, len(marked)
    start = int(np.argmin(marked))  # not marked, so that no run goes over the end
    run = fullest_run(np.roll(marked, -start), gap=1)
    return (0, 0) if run is None else ((start + run[0]) % len(marked), run[1] - run[0] + 1)


def turning_of(rings: Sequence[Image]) -> int:
    """+1 where the beads at the wall go clockwise in the picture, -1 anticlockwise, 0 where it is not told.

    `rings` are a sector's pixels in every frame.  What never moves, dirt and reflections, is taken off them first.  A
    later picture is laid over an earlier one and the other way round: what only flickers or jitters looks alike both
    ways, what goes on does not.
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
        # by how far the later one is turned clockwise: forth, and back with its sign turned
        alike = np.array([_likeness(one, other, reach) + _likeness(other, one, reach)[::-1] for one, other in pairs])
        moved = max(abs(int(np.argmax(alike.mean(axis=0))) - reach), LEAST_STEP)
        onward = alike[:, reach + moved] - alike[:, reach - moved]
        mean, error = float(onward.mean()), float(onward.std(ddof=1)) / math.sqrt(len(onward))
        if abs(mean) > max(CLEAR, SURE * error):
            return 1 if mean > 0 else -1
    return 0


def _likeness(earlier: FloatImage, later: FloatImage, reach: int) -> Array:
    """Correlation of the later picture's parts with the earlier one's middle, by shifts from -reach to +reach."""
    middle = earlier[:, reach : earlier.shape[1] - reach]
    return np.asarray(cv2.matchTemplate(later, middle, cv2.TM_CCOEFF_NORMED)[0], dtype=np.float64)


def stance_checks(aside: float, turning: int, rises: float) -> list[Check]:
    """Whether the picture stands upright: by where the bed's middle lies about the drum's axis [rad], and by whether
    the surface, which `rises` to the right (+1) or left (-1), does so the way in which the beads at the wall go.
    """
    checks = []
    if math.isfinite(aside):
        degrees = math.degrees(abs(aside))
        passed = degrees < MOST_ASIDE
        ending = "." if passed else ": no flowing bed does; the picture lies on its side, or --camera-roll is wrong."
        message = f"the bed's middle lies {degrees:.0f} degrees aside of straight below the drum's axis{ending}"
        checks.append(Check("bed_below", passed, degrees, 0.0, message))
    if turning:
        way, side = "clockwise" if turning > 0 else "anticlockwise", "right" if rises > 0 else "left"
        passed = turning * rises < 0
        message = f"the beads at the wall go {way}, {'and' if passed else 'but'} the surface rises to the {side}"
        ending = "." if passed else ": the picture lies on its side, or the film runs backwards."
        checks.append(Check("turning", passed, float(turning), -rises, message + ending))
    return checks
