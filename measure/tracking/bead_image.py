from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from rigtwin.lab.arrays import Array


@dataclass(frozen=True)
class BeadImage:
    """A bead as one frame shows it."""

    x: float  # [px]
    y: float  # [px]
    sigma: float  # [px], one standard deviation of each coordinate
    radius: float  # [px]
    blur: tuple[float, float]  # [px], path of the centre during the exposure; its sign is not seen
    contrast: float  # [grey levels], mean difference between the bead and what it hides, signed


@dataclass(frozen=True)
class Look:
    """What a bead looks like wherever it is: learnt from many frames, it steadies the fit of each."""

    radius: float  # [px]
    edge: float  # [px], softness of the rim
    light: Array  # [grey levels]: constant, slope in x, slope in y, bulge, shape (4,)


@dataclass(frozen=True)
class Shading:
    """The light's slopes in one frame: their freedom costs more of the centre than that of all else together.

    A bead brighter on its left looks much like one further left.
    """

    slopes: Array  # [grey levels per radius] in x and y, shape (2,)
    covariance: Array  # of x, y [px] and the slopes, shape (4, 4)
    usual: Array  # slopes that were held likely, shape (2,)
    spread: Array  # and how far off, shape (2,)


@dataclass(frozen=True)
class BeadFit:
    """A located bead with what its pixels say of its look."""

    image: BeadImage
    look: Look
    misfit: float  # [grey levels], mean absolute residual
    shading: Shading
    information: Array  # of all parameters, the pixels of a patch alone, shape (n, n)
    step: int  # picture pixels per patch pixel

    def certainty(self) -> Array:
        """Inverse covariance of (radius, edge, light), shape (6, 6).

        What is left of the information when place, blur and scene of this frame are unknown (Schur complement).
        """
        mine = np.array([2, 3, *range(SHAPES, SHAPES + LIGHTS)])
        other = np.array([k for k in range(len(self.information)) if k not in mine])
        cross = self.information[np.ix_(mine, other)]
        inside = self.information[np.ix_(other, other)] + np.diag(np.full(len(other), 1e-9))
        schur = self.information[np.ix_(mine, mine)] - cross @ np.linalg.lstsq(inside, cross.T, rcond=None)[0]
        unit = np.array([self.step, self.step, 1, 1, 1, 1])
        return np.asarray(schur / np.outer(unit, unit))

    def with_slopes(self, slopes: Array, spread: Array) -> BeadImage:
        """The bead had it been known that the light's slopes are these, give or take `spread`.

        No new fit: near its best, what is known beforehand shifts a fit of least squares in proportion.
        """
        known, light = self.shading, self.shading.covariance[:, 2:]
        more = np.diag(1 / spread**2 - 1 / known.spread**2)
        pull = (slopes - known.slopes) / spread**2 - (known.usual - known.slopes) / known.spread**2
        gain = light @ np.linalg.inv(np.eye(2) + more @ light[2:])
        x, y = (gain @ pull)[:2].tolist()
        left = known.covariance - gain @ more @ light.T
        sigma = math.sqrt(max(float(left[0, 0] + left[1, 1]) / 2, LEAST_SIGMA**2))
        return replace(self.image, x=self.image.x + x, y=self.image.y + y, sigma=sigma)


LEAST_SIGMA = 0.004  # [px], for what is left of faults of the model

SHAPES = 6

LIGHTS = 4
