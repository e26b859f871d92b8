"""Direction of the horizontal in a picture, from long level edges such as those of the base plate under a rig.

If the camera looks slightly from the side, edges that are parallel in space converge in the picture: their slope
changes linearly with the picture row. The fit of slope against row gives the horizontal at any height.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from rigtwin.lab.arrays import Array, FloatImage
from rigtwin.lab.camera import FOCAL_LENGTH, FOCAL_UNCERTAINTY
from rigtwin.measure.geometry.lines import Line, long_lines

MOST_ROLL = math.radians(8)  # largest slope of an edge that counts as level
SIDEWAYS = math.radians(2.0)  # prior standard deviation of the angle between view and normal of the rig's plane
# [rad], prior standard deviation of the convergence over the width of the picture: root mean square of
# tan(SIDEWAYS) / f over the focal lengths f [picture widths] of an unknown lens, which are lognormal
CONVERGENCE_STD = math.tan(SIDEWAYS) / FOCAL_LENGTH * math.exp(FOCAL_UNCERTAINTY**2)
NOT_QUITE = math.radians(0.012)  # standard uncertainty of straightness and parallelism of a plate's edges
ELSEWHERE = math.radians(0.15)  # the same for long edges of a picture without a base plate
# the same for edges that are none of the plate, of which some are the pattern of a wall: 32 films of tilts by VTK (make
# bench-unseen), and 5 by a path tracer
ALONE = math.radians(0.5)
FAINT = 0.35  # minimum strength of a plate's edge relative to the strongest one
# largest standard uncertainty of an edge's direction: with 0.1 to 0.25 degrees 119 pictures of tilts by VTK have equal
# errors, with 0.5 their root mean square is five times as large
POOR = math.radians(0.15)
ODD = 4.0  # residuals are clipped at this many standard uncertainties
PARALLEL = math.radians(0.7)  # largest difference between edges that count as parallel


@dataclass(frozen=True)
class Level:
    """Slope of the horizontal as a linear function of the picture row."""

    slope: float  # [rad], at the picture's centre, positive if it falls to the right
    slope_sigma: float  # [rad]
    converging: float  # [rad/px], change of the slope per row downwards
    converging_sigma: float  # [rad/px]
    lines: tuple[Line, ...]  # edges used in the fit
    centre: tuple[float, float]  # [px], centre of the picture
    covariance: float = 0.0  # [rad^2/px], of slope and converging

    def at(self, row: float) -> tuple[float, float]:
        """Slope of the horizontal and its standard uncertainty [rad] at a row [px] of the picture."""
        below = row - self.centre[1]
        variance = self.slope_sigma**2 + (below * self.converging_sigma) ** 2 + 2 * below * self.covariance
        return self.slope + below * self.converging, math.sqrt(max(variance, 0.0))


def find_level(
    picture: FloatImage, still: npt.NDArray[np.bool_], below: float, converging: tuple[float, float] | None = None
) -> Level | None:
    """The horizontal of a static background; None if no long level edge is found.

    `still` marks pixels without moving objects. `below` [px] is the lowest row that cannot belong to the base plate.
    `converging` is the convergence from other parallel edges with its standard uncertainty [rad/px].
    """
    lines = long_lines(picture, still, steepest=MOST_ROLL, shortest=0.3 * picture.shape[1], most=24)
    lines = [line for line in lines if line.sigma < POOR]
    if not lines:
        return None
    height, width = picture.shape
    strongest = max((line.strength for line in lines if line.middle[1] > below), default=0.0)
    # faint lines below the rig are wood grain of a table or borders of shadows
    plate = np.array([line.middle[1] > below and line.strength > FAINT * strongest for line in lines])
    systematic = np.where(plate, NOT_QUITE, ALONE)
    centre = ((width - 1) / 2, (height - 1) / 2)
    usual = 0.0, CONVERGENCE_STD / width
    return _fit(lines, systematic, centre, usual if converging is None else _combined(usual, converging))


def level_of(lines: list[Line], shape: tuple[int, ...], given: float | None = None) -> Level:
    """Common direction of long edges and its change per row; `given` is the slope [rad] if known."""
    height, width = shape[:2]
    centre = ((width - 1) / 2, (height - 1) / 2)
    usual = 0.0, CONVERGENCE_STD / width
    good = [line for line in lines if line.sigma < POOR]
    if given is not None or not good:
        kept = [line for line in good if given is None or abs(line.slope - given) < PARALLEL]
        return Level(given or 0.0, ALONE, 0.0, usual[1], tuple(kept), centre)
    return _fit(good, np.full(len(good), ELSEWHERE), centre, usual)


def _combined(one: tuple[float, float], other: tuple[float, float]) -> tuple[float, float]:
    """Weighted mean of two values and its standard uncertainty."""
    weight = np.array([1 / one[1] ** 2, 1 / other[1] ** 2])
    return float(weight @ [one[0], other[0]] / weight.sum()), 1 / math.sqrt(float(weight.sum()))


def _fit(lines: list[Line], systematic: Array, centre: tuple[float, float], usual: tuple[float, float]) -> Level:
    """Robust line fit of slope against row.

    `systematic` is the uncertainty of each edge as a horizontal [rad], `usual` the prior of the convergence: mean and
    standard deviation [rad/px].
    """
    rows = np.array([line.middle[1] - centre[1] for line in lines])
    slopes = np.array([line.slope for line in lines])
    sigma = np.hypot([line.sigma for line in lines], systematic)
    worth = np.array([line.length * min(line.strength, 10.0) for line in lines]) / sigma
    # start from the direction with the largest total weight
    leader = slopes[int(np.argmax([np.sum(worth * (np.abs(slopes - s) < PARALLEL)) for s in slopes]))]
    kept = np.abs(slopes - leader) < PARALLEL
    rows, slopes, sigma, systematic = rows[kept], slopes[kept], sigma[kept], systematic[kept]
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
    if len(lines) > 2:  # scale the covariance by the reduced chi-square if the edges disagree
        covariance = covariance * max(1.0, float(np.sum(np.minimum(miss, ODD) ** 2)) / (len(lines) - 2))
    # edges of one plate share its systematic errors, which do not average out
    own = math.hypot(math.sqrt(covariance[0, 0]), float(systematic.min()) / 2)
    return Level(
        float(answer[0]),
        own,
        float(answer[1]),
        math.sqrt(float(covariance[1, 1])),
        tuple(lines),
        centre,
        float(covariance[0, 1]),
    )
