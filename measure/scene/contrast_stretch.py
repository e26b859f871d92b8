"""Dark or dull pictures brought to the range of well exposed ones, so that colours differ by as much as they should."""

from __future__ import annotations

from dataclasses import dataclass, field

import cv2
import numpy as np
import numpy.typing as npt

from rigtwin.lab.arrays import Image

FULL_RANGE = 200.0  # [grey levels], between dark and bright in a well exposed picture
NARROW = 0.77  # of it, below which a picture is stretched
DIMMEST = 8.0  # [grey levels], a smaller range is noise


@dataclass(frozen=True)
class Exposure:
    """A straight line from what the camera gave to what a well exposed picture shows, the same in all three colours."""

    gain: float
    table: Image = field(repr=False)  # new grey level by old one, shape (256,)

    def applied(self, picture: Image) -> Image:
        """The picture, stretched where it needs to be."""
        if self.gain == 1:
            return picture
        return np.asarray(cv2.LUT(picture, self.table), dtype=np.uint8)


def exposure_of(grey: npt.NDArray[np.uint8] | npt.NDArray[np.float32]) -> Exposure:
    """How to stretch pictures like this one; 1 in 200 pixels at either end may be a lamp or a hole."""
    low, high = (float(each) for each in np.percentile(grey, (0.5, 99.5)))
    levels = np.arange(256, dtype=np.float64)
    if high - low > NARROW * FULL_RANGE:
        return Exposure(1.0, levels.astype(np.uint8))
    gain = FULL_RANGE / max(high - low, DIMMEST)
    stretched = (levels - low) * gain + (255 - FULL_RANGE) / 2
    return Exposure(gain, np.clip(np.rint(stretched), 0, 255).astype(np.uint8))
