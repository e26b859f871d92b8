"""Stretch dark or low-contrast pictures to the range of well exposed ones, so that colour limits apply to both."""

from __future__ import annotations

from dataclasses import dataclass, field

import cv2
import numpy as np
import numpy.typing as npt

from rigtwin.lab.arrays import Image

FULL_RANGE = 200.0  # [grey levels], brightness range of a well exposed picture
NARROW = 0.77  # of FULL_RANGE; a picture with a smaller range is stretched
DIMMEST = 8.0  # [grey levels], a smaller range counts as noise


@dataclass(frozen=True)
class Exposure:
    """Linear map of grey levels, the same for all three colours."""

    gain: float
    table: Image = field(repr=False)  # new grey level for each old one, shape (256,)

    def applied(self, picture: Image) -> Image:
        """The stretched picture; unchanged if the gain is 1."""
        if self.gain == 1:
            return picture
        return np.asarray(cv2.LUT(picture, self.table), dtype=np.uint8)


def exposure_of(grey: npt.NDArray[np.uint8] | npt.NDArray[np.float32]) -> Exposure:
    """The contrast stretch for pictures like this one; 0.5 % of the pixels at either end may be outliers."""
    low, high = (float(each) for each in np.percentile(grey, (0.5, 99.5)))
    levels = np.arange(256, dtype=np.float64)
    if high - low > NARROW * FULL_RANGE:
        return Exposure(1.0, levels.astype(np.uint8))
    gain = FULL_RANGE / max(high - low, DIMMEST)
    stretched = (levels - low) * gain + (255 - FULL_RANGE) / 2
    return Exposure(gain, np.clip(np.rint(stretched), 0, 255).astype(np.uint8))
