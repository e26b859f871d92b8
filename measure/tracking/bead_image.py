"""Results of the bead fit: position, look (radius, edge, light) and shading of a bead in one frame."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from rigtwin.lab.arrays import Array


@dataclass(frozen=True)
class BeadImage:
    """Position, radius and motion blur of a bead in one frame."""

    x: float  # [px]
    y: float  # [px]
    sigma: float  # [px], standard uncertainty of each coordinate
    radius: float  # [px]
    blur: tuple[float, float]  # [px], path of the centre during the exposure; its sign is not observable
    contrast: float  # [grey levels], mean signed difference between the bead and the background


@dataclass(frozen=True)
class Look:
    """Radius, edge and light of a bead, common to all frames; a prior that stabilises the fit of each frame."""

    radius: float  # [px]
    edge: float  # [px], softness of the rim
    light: Array  # [grey levels]: constant, slope in x, slope in y, bulge, shape (4,)


@dataclass(frozen=True)
class Shading:
    """Slopes of the light in one frame, with their covariance with the centre.

    The slopes correlate with the centre more strongly than all other parameters: a bead brighter on its left looks
    much like one further left.
    """

    slopes: Array  # [grey levels per radius] in x and y, shape (2,)
    covariance: Array  # of x, y [px] and the slopes, shape (4, 4)
    usual: Array  # prior mean of the slopes, shape (2,)
    spread: Array  # prior standard deviation of the slopes, shape (2,)


@dataclass(frozen=True)
class BeadFit:
    """A fitted bead with its look and the information of its pixels."""

    image: BeadImage
    look: Look
    misfit: float  # [grey levels], mean absolute residual
    shading: Shading
    information: Array  # Fisher information of all parameters from the pixels alone, shape (n, n)
    step: int  # picture pixels per patch pixel

    def certainty(self) -> Array:
        """Inverse covariance of (radius, edge, light), shape (6, 6).

        The information after marginalising over position, blur and background of this frame (Schur complement).
        """
        mine = np.array([2, 3, *range(SHAPES, SHAPES + LIGHTS)])
        other = np.array([k for k in range(len(self.information)) if k not in mine])
        cross = self.information[np.ix_(mine, other)]
        inside = self.information[np.ix_(other, other)] + np.diag(np.full(len(other), 1e-9))
        schur = self.information[np.ix_(mine, mine)] - cross @ np.linalg.lstsq(inside, cross.T, rcond=None)[0]
        unit = np.array([self.step, self.step, 1, 1, 1, 1])
        return np.asarray(schur / np.outer(unit, unit))

    def with_slopes(self, slopes: Array, spread: Array) -> BeadImage:
        """The bead with the prior of the light's slopes replaced by `slopes` +- `spread`, each of shape (2,).

        No new fit: near the optimum a least-squares solution changes linearly with the prior.
        """
        known, light = self.shading, self.shading.covariance[:, 2:]
        more = np.diag(1 / spread**2 - 1 / known.spread**2)
        pull = (slopes - known.slopes) / spread**2 - (known.usual - known.slopes) / known.spread**2
        gain = light @ np.linalg.inv(np.eye(2) + more @ light[2:])
        x, y = (gain @ pull)[:2].tolist()
        left = known.covariance - gain @ more @ light.T
        sigma = math.sqrt(max(float(left[0, 0] + left[1, 1]) / 2, LEAST_SIGMA**2))
        return replace(self.image, x=self.image.x + x, y=self.image.y + y, sigma=sigma)


LEAST_SIGMA = 0.004  # [px], lower limit of the standard uncertainty, for remaining errors of the model

SHAPES = 6  # number of shape parameters: x, y, radius, edge, blur x, blur y

LIGHTS = 4  # number of light parameters: constant, slope x, slope y, bulge
