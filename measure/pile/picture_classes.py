"""Divide a picture into classes of colour and texture, and compare the shares that regions have of them.

The classes are found in each picture anew, so nothing is assumed about the looks of grains, base and background.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from rigtwin.lab.arrays import Array, Image

CLASSES = 24
WIDTH = 500  # [px] of the reduced picture that is divided
SAMPLED = 4000  # pixels from which the classes are found
ROUNDS = 12  # of k-means
WINDOWS = (5, 11)  # [px] of the reduced picture, windows of roughness: smaller and larger than most grains
LIGHTNESS = 0.5  # weight of lightness against hue, because shadows change lightness most
ROUGHNESS = 6.0  # [CIELAB units] that doubling the roughness counts


@dataclass(frozen=True)
class PictureClasses:
    """Class of every pixel of a reduced picture."""

    label: npt.NDArray[np.uint8]  # shape (height, width)
    zoom: float  # px of the reduced picture per px of the picture

    def shares(
        self, x: npt.NDArray[np.floating], y: npt.NDArray[np.floating], sizes: Mapping[str, int]
    ) -> dict[str, Array]:
        """Share of every class in regions that are given by sample points.

        Parameters
        ----------
        x, y : array, shape (n, points)
            Points [px] of n candidates; points beyond the picture count as its nearest pixel.
        sizes : mapping
            Number of points of each region, in the order of the columns of `x`.

        Returns
        -------
        dict
            Shares of shape (n, classes) by region.
        """
        map_x, map_y = (np.asarray(part * self.zoom, dtype=np.float32) for part in (x, y))
        seen = cv2.remap(self.label, map_x, map_y, cv2.INTER_NEAREST, borderMode=cv2.BORDER_REPLICATE)
        count, regions = len(seen), len(sizes)
        region = np.repeat(np.arange(regions), list(sizes.values()))
        cell = (np.arange(count)[:, None] * regions + region) * CLASSES + seen
        found = np.bincount(cell.ravel(), minlength=count * regions * CLASSES).reshape(count, regions, CLASSES)
        return {name: found[:, at] / size for at, (name, size) in enumerate(sizes.items())}


def classes_of(picture: Image) -> PictureClasses:
    """Classes of a picture in BGR order, shape (height, width, 3), by k-means of CIELAB colour and roughness."""
    from scipy.cluster.vq import kmeans2, vq

    zoom = min(1.0, WIDTH / picture.shape[1])
    small = _lab(cv2.resize(picture, None, fx=zoom, fy=zoom, interpolation=cv2.INTER_AREA))
    lightness, *hues = cv2.split(cv2.GaussianBlur(small, (0, 0), 1.0))
    fine = np.asarray(cv2.GaussianBlur(small[..., 0], (0, 0), 0.8), dtype=np.float32)
    layers = [LIGHTNESS * lightness, *hues, *(_roughness(fine, window) for window in WINDOWS)]
    features = np.stack(layers, axis=-1, dtype=np.float32).reshape(-1, len(layers))
    some = np.random.default_rng(0).choice(features, min(SAMPLED, len(features)), replace=False)
    count = min(CLASSES, len(np.unique(some, axis=0)))
    centres, _ = kmeans2(some, count, iter=ROUNDS, minit="++", rng=0)
    label, _ = vq(features, centres)
    return PictureClasses(label.reshape(small.shape[:2]).astype(np.uint8), zoom)


def divergences(shares: Mapping[str, Array], pairs: Sequence[tuple[str, str]]) -> list[Array]:
    """Jensen-Shannon divergences [bit] of pairs of regions: 0 for equal shares, 1 if no class is in both."""
    from scipy.special import entr

    bits = {name: entr(share).sum(axis=-1) for name, share in shares.items()}
    mixed = [entr((shares[one] + shares[other]) / 2).sum(axis=-1) for one, other in pairs]
    return [
        (mixed - (bits[one] + bits[other]) / 2) / np.log(2) for mixed, (one, other) in zip(mixed, pairs, strict=True)
    ]


def _lab(picture: npt.NDArray[Any]) -> npt.NDArray[np.float32]:
    return np.asarray(cv2.cvtColor(picture.astype(np.float32) / 255, cv2.COLOR_BGR2LAB), dtype=np.float32)


def _roughness(lightness: npt.NDArray[np.float32], window: int) -> npt.NDArray[np.float32]:
    size = (window, window)
    mean = cv2.blur(lightness, size)
    rough = np.sqrt(np.maximum(cv2.blur(lightness * lightness, size) - mean * mean, 0))
    # smoothest window that contains the pixel (Kuwahara et al. 1976), so that an edge adds no roughness beside it
    smoothest = cv2.erode(rough, np.ones(size, np.uint8))
    return np.asarray(ROUGHNESS * np.log2(smoothest + 0.5), dtype=np.float32)
