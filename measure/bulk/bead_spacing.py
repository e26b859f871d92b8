"""Distance of neighbouring beads in the picture of a bed from its autocorrelation, without detecting single beads.

The first ring of the autocorrelation lies at the mean distance of neighbours. This also works for beads a few pixels
wide, blurred or shaded, whose rims are not visible.
"""

from __future__ import annotations

import math

import cv2
import numpy as np
import numpy.typing as npt

from rigtwin.lab.arrays import Array, Image, Mask

PARTS = 2  # shifts per pixel
FINE = 8.0  # [px], sigma of the first high-pass filter
CLEAR = 0.03  # minimum correlation at the first ring
LEAST = 3.0  # [px], smallest distance of neighbours that is resolved
RING = (1.3, 2.4)  # search range of the ring, in units of the first minimum (slightly more than half a diameter)
LARGEST = 0.34  # of the bed's smaller side, largest distance of neighbours


def bead_spacing(image: Image, bed: Mask) -> float | None:
    """Distance [px] of neighbouring beads in a picture (BGR or grey), None if no ring is clear.

    `bed` marks the pixels of the bed, shape (height, width).
    """
    grey = image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
    rows, columns = np.flatnonzero(bed.any(axis=1)), np.flatnonzero(bed.any(axis=0))
    if len(rows) < 8 or len(columns) < 8:
        return None
    box = slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1)
    picture, inside = grey[box].astype(np.float32), bed[box].astype(np.float32)
    found = None
    for _ in range(3):  # remove the illumination, which varies over more than a bead or two
        found = _first_ring(_correlation(picture, inside, FINE if found is None else 0.8 * found))
        if found is None:
            return None
    return found if found is not None and found > LEAST else None


def _correlation(picture: npt.NDArray[np.float32], inside: npt.NDArray[np.float32], fine: float) -> Array:
    """Autocorrelation of the high-pass filtered bed over the radial shift in steps of 1 / PARTS px; 1 at zero shift."""
    share = np.maximum(cv2.GaussianBlur(inside, (0, 0), fine), 1e-3)
    pattern = (picture - cv2.GaussianBlur(picture * inside, (0, 0), fine) / share) * inside
    size = [cv2.getOptimalDFTSize(2 * side) for side in pattern.shape]
    both = np.fft.irfft2(np.abs(np.fft.rfft2(pattern, size)) ** 2, size)
    pairs = np.fft.irfft2(np.abs(np.fft.rfft2(inside, size)) ** 2, size)
    y, x = (np.minimum(np.arange(side), side - np.arange(side)) for side in size)
    shift = np.rint(PARTS * np.hypot(y[:, None], x[None, :])).astype(np.int64)
    near = shift < PARTS * LARGEST * min(pattern.shape)
    sums = [np.bincount(shift[near], each[near]) for each in (both, pairs)]
    mean = sums[0] / np.maximum(sums[1], 1.0)
    return np.asarray(mean / max(float(mean[0]), 1e-9))


def _first_ring(correlation: Array) -> float | None:
    """Radius [px] of the first maximum beyond the first minimum; None if there is none."""
    smooth = np.convolve(correlation, (0.25, 0.5, 0.25), mode="same")[:-1]
    below = np.flatnonzero(smooth < 0)
    if len(below) == 0:
        return None
    lowest = below[0] + int(np.argmin(smooth[below[0] : 3 * below[0] + 1]))
    # take the first ring: in a blurred picture the second one may be higher
    highest = [
        k
        for k in range(math.ceil(RING[0] * lowest), min(int(RING[1] * lowest), len(smooth) - 1))
        if smooth[k] > CLEAR and smooth[k] >= smooth[k - k // 6 - 1 : k + k // 6 + 2].max()
    ]
    if not highest:
        return None
    top = highest[0]
    # the ring is broad: fit a parabola to its upper part
    width = max(2, top // 8)
    near = np.arange(max(top - width, lowest), min(top + width + 1, len(smooth)))
    bend, slope, _ = np.polyfit(near - top, smooth[near], 2)
    off = -slope / (2 * bend) if bend < 0 else 0.0
    return float(top + np.clip(off, -width, width)) / PARTS if math.isfinite(off) else None
