"""Whether the beads of a bed look as large as stated, and what is told where nothing in the picture says so."""

from __future__ import annotations

from rigtwin.lab.quantity import Check

# relative, by which single beads may look larger or smaller than they are: shaded rims are soft, and their size
# scatters by 0.04 from photo to photo, whatever blur, noise and light
MISFIT = 0.16


def size_seen(ratio: float, most: float, scale_from: str) -> Check:
    """`ratio` of the size seen, by the scale, to the one stated; `most` it may be off by."""
    passed = abs(ratio - 1) < most
    usual = f"{max(1 - most, 0):.2f} to {1 + most:.2f} is let pass"
    ending = "." if passed else f": check --bead-diameter, and the scale (from {scale_from})."
    message = f"beads look {ratio:.2f} times as large as stated; {usual}{ending}"
    return Check("bead_size", passed, ratio, 1.0, message)


def size_unseen(what: str, given: str, advice: str) -> str:
    """Nothing contradicts the one size that all lengths hang on, and nothing confirms it: a warning, no check."""
    return f"size not confirmed: {what} on {given} alone, which nothing in the picture checks; {advice}."
