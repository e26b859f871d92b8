"""Openings and closings of a mask by a disc."""

from __future__ import annotations

import cv2
import numpy as np

from rigtwin.lab.arrays import Marked


def odd(size: float) -> int:
    """Diameter [px] of a disc with a pixel in its middle and others around it."""
    return max(3, round(size) | 1)


def disc(across: int) -> Marked:
    """Disc of a diameter [px]."""
    return np.asarray(cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (across, across)), dtype=np.uint8)


def closed(mask: Marked, across: int) -> Marked:
    """The mask without gaps in which a disc of this diameter [px] has no room."""
    return np.asarray(cv2.morphologyEx(mask, cv2.MORPH_CLOSE, disc(across)), dtype=np.uint8)


def opened(mask: Marked, across: int) -> Marked:
    """The mask without parts in which a disc of this diameter [px] has no room."""
    return np.asarray(cv2.morphologyEx(mask, cv2.MORPH_OPEN, disc(across)), dtype=np.uint8)
