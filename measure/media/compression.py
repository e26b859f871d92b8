"""Detect over-compressed video (bits per pixel); the codec freezes low-contrast motion."""

from __future__ import annotations

import math

from rigtwin.lab.quantity import Check
from rigtwin.measure.media.video import Video


def compression_check(video: Video, least: float, moving: float = 1.0, few: float = 0.0) -> Check:
    """Check `compression`: mean bits per pixel against `least`, the minimum that the rig's recording needs.

    `moving` is the share of the picture that changes. The bits are then counted per changing pixel, because a codec
    spends almost none on the still rest. If bpp < `few`, the caller adds one frame to the timing uncertainty.
    """
    if not video.path.is_file():
        return Check("compression", True, math.inf, least, "a folder of pictures is not video-compressed.")
    bits = _bits(video) / moving
    passed = bits > least
    ending = "."
    if not passed:
        ending = ": too few; low-contrast motion freezes for a frame or more. Give the original file."
    elif bits < few:
        ending = ": few; low-contrast motion may freeze for a frame. The timing uncertainty includes one frame."
    where = "" if moving == 1 else " of the moving part"
    return Check("compression", passed, bits, least, f"the clip has {bits:.3g} bits per pixel{where}{ending}")


def by_bits(video: Video) -> str:
    """Advice for a recording in which compression may hide the searched event, with its bits per pixel."""
    if not video.path.is_file():
        return ""
    return f"; strong compression may hide motion, so give the original file ({_bits(video):.2g} bits per pixel here)"


def _bits(video: Video) -> float:
    """Mean bits per pixel of the file."""
    return 8 * video.path.stat().st_size / (video.width * video.height * max(len(video.times), 1))
