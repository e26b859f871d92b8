"""Whether a film has bits enough to show what is faint: a codec that has not leaves it standing still."""

from __future__ import annotations

import math

from rigtwin.lab.quantity import Check
from rigtwin.measure.media.video import Video


def compression_check(video: Video, least: float, moving: float = 1.0, few: float = 0.0) -> Check:
    """`compression`, by the bits that a picture's pixels have on the average; `least` is what the rig's film needs.

    Where `moving` is the share of the picture that changes, by the bits of these pixels: a codec spends next to none on
    what stays.  With less than `few` of them times need a frame of doubt, which is for whoever asks to put there.
    """
    if not video.path.is_file():
        return Check("compression", True, math.inf, least, "pictures in a folder leave nothing out.")
    bits = _bits(video) / moving
    passed = bits > least
    ending = "."
    if not passed:
        ending = ": so few that faint things stand still in it for a frame or more; give the original."
    elif bits < few:
        ending = ": few, so that faint things may stand still in it for a frame, which is in the doubt of its times."
    where = "" if moving == 1 else " of what moves"
    return Check("compression", passed, bits, least, f"the clip has {bits:.3g} bits per pixel{where}{ending}")


def by_bits(video: Video) -> str:
    """What to do where a codec may have left out what is looked for, with the bits by which one can judge it."""
    if not video.path.is_file():
        return ""
    return (
        f" If one does, strong compression ({_bits(video):.2g} bits per pixel here) has smeared it: give the original."
    )


def _bits(video: Video) -> float:
    """Bits that a picture's pixels have on the average."""
    return 8 * video.path.stat().st_size / (video.width * video.height * max(len(video.times), 1))
