"""The horizontal in a picture, from the long level edges of the base plate under a rig.

Edges that are parallel in space run together in the picture when the camera looks at them slightly from the side: their
slope then changes steadily with their height in the picture.  The level at another height follows from that.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from rigtwin.lab.arrays import Array, FloatImage
from rigtwin.measure.geometry.lines import Line, long_lines

MOST_ROLL = math.radians(8)
SIDEWAYS = math.radians(2.0)  # usual angle between the camera's view and the normal of the rig's plane
FOCAL_WIDTHS = 1.6  # usual focal length in picture widths: enough to say how fast parallel edges may run together
NOT_QUITE = math.radians(0.012)  # how straight and parallel the edges of a plate are
ELSEWHERE = math.radians(0.15)  # how level and parallel to the rig the edges of other things are: a shelf, a scale
ALONE = math.radians(0.5)  # the same, where no edge of the plate is seen
FAINT = 0.35  # strength of an edge of the plate over that of the strongest
POOR = math.radians(0.06)  # an edge whose direction is less certain is no edge of a plate
ODD = 4.0  # times its uncertainty, that an edge counts as off at most
PARALLEL = math.radians(0.7)  # edges that differ more are not taken for parallel


@dataclass(frozen=True)
class Level:
    """How the horizontal runs through a picture."""

    slope: float  # [rad], through the picture's middle, positive where it falls to the right
    slope_sigma: float  # [rad]
    converging: float  # [rad/px], change of the slope per row downwards
    converging_sigma: float  # [rad/px]
    lines: tuple[Line, ...]  # the edges it rests on
    centre: tuple[float, float]  # [px], of the picture
    covariance: float = 0.0  # [rad^2/px], between slope and converging

    def at(self, row: float) -> tuple[float, float]:
        """Slope of the horizontal and its standard uncertainty [rad] at a row [px] of the picture."""
        below = row - self.centre[1]
        variance = self.slope_sigma**2 + (below * self.converging_sigma) ** 2 + 2 * below * self.covariance
        return self.slope + below * self.converging, math.sqrt(max(variance, 0.0))


def find_level(
    picture: FloatImage, still: npt.NDArray[np.bool_], below: float, converging: tuple[float, float] | None = None
) -> Level | None:
    """The horizontal of a still scene; `still` marks pixels that nothing moves over, `below` [px] is the lowest row
    that cannot belong to the base plate, `converging` what other parallel edges say of their convergence, with its
    standard uncertainty [rad/px].  None when no long level edge is seen.
    """
    lines = long_lines(picture, still, steepest=MOST_ROLL, shortest=0.3 * picture.shape[1], most=24)
    lines = [line for line in lines if line.sigma < POOR]
    if not lines:
        return None
    height, width = picture.shape
    strongest = max((line.strength for line in lines if line.middle[1] > below), default=0.0)
    # faint lines below the rig are the grain of a table or a shadow's border
    plate = np.array([line.middle[1] > below and line.strength > FAINT * strongest for line in lines])
    doubt = np.where(plate, NOT_QUITE, ELSEWHERE) if np.any(plate) else np.full(len(lines), ALONE)
    centre = ((width - 1) / 2, (height - 1) / 2)
    usual = 0.0, math.tan(SIDEWAYS) / (FOCAL_WIDTHS * width)
    return _fit(lines, doubt, centre, usual if converging is None else _combined(usual, converging))


def level_of(lines: list[Line], shape: tuple[int, ...], given: float | None = None) -> Level:
    """The direction that long edges share, and how it changes from row to row; `given` [rad] where it is known."""
    height, width = shape[:2]
    centre = ((width - 1) / 2, (height - 1) / 2)
    usual = 0.0, math.tan(SIDEWAYS) / (FOCAL_WIDTHS * width)
    good = [line for line in lines if line.sigma < POOR]
    if given is not None or not good:
        kept = [line for line in good if given is None or abs(line.slope - given) < PARALLEL]
        return Level(given or 0.0, ALONE, 0.0, usual[1], tuple(kept), centre)
    return _fit(good, np.full(len(good), ELSEWHERE), centre, usual)


def _combined(one: tuple[float, float], other: tuple[float, float]) -> tuple[float, float]:
    """Weighted mean of two values and its standard uncertainty."""
    weight = np.array([1 / one[1] ** 2, 1 / other[1] ** 2])
    return float(weight @ [one[0], other[0]] / weight.sum()), 1 / math.sqrt(float(weight.sum()))


def _fit(lines: list[Line], doubt: Array, centre: tuple[float, float], usual: tuple[float, float]) -> Level:
    """Slope against row, robust, with what is usual for the convergence."""
    rows = np.array([line.middle[1] - centre[1] for line in lines])
    slopes = np.array([line.slope for line in lines])
    sigma = np.hypot([line.sigma for line in lines], doubt)
    worth = np.array([line.length * min(line.strength, 10.0) for line in lines]) / sigma
    # the direction that most edges share
    leader = slopes[int(np.argmax([np.sum(worth * (np.abs(slopes - s) < PARALLEL)) for s in slopes]))]
    kept = np.abs(slopes - leader) < PARALLEL
    rows, slopes, sigma, doubt = rows[kept], slopes[kept], sigma[kept], doubt[kept]
    lines = [line for line, keep in zip(lines, kept, strict=True) if keep]
    usual_weight = np.ones(len(lines))
    design = np.column_stack([np.ones_like(rows), rows])
    answer, covariance = np.array([leader, 0.0]), np.eye(2)
    for _ in range(10):
        w = usual_weight / sigma**2
        covariance = np.linalg.inv((design * w[:, None]).T @ design + np.diag([0.0, 1 / usual[1] ** 2]))
        answer = covariance @ (design.T @ (w * slopes) + np.array([0.0, usual[0] / usual[1] ** 2]))
        miss = np.abs(slopes - design @ answer) / sigma
        usual_weight = 1 / (1 + (miss / 3) ** 2) ** 2
    if len(lines) > 2:  # edges that do not run together tell less than each of them would
        covariance = covariance * max(1.0, float(np.sum(np.minimum(miss, ODD) ** 2)) / (len(lines) - 2))
    # edges of one plate share its flaws: their number does not average these out
    own = math.hypot(math.sqrt(covariance[0, 0]), float(doubt.min()) / 2)
    return Level(
        float(answer[0]),
        own,
        float(answer[1]),
        math.sqrt(float(covariance[1, 1])),
        tuple(lines),
        centre,
        float(covariance[0, 1]),
    )
