"""Whether the beads of a bed look as large as stated, and what is told where nothing in the picture says so."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

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


CHANCE = 1e-3  # how rarely views of one thing may scatter that much


def views_check(what: str, values: Sequence[float], sigmas: Sequence[float], unit: str) -> Check:
    """Whether `values` of `what`, one a view, agree within `sigmas`, what of their doubts views do not share.

    Weighted sum of squares about their weighted mean, which for views of one thing follows chi squared.
    """
    from scipy.stats import chi2

    value, weight = np.asarray(values, dtype=np.float64), 1 / np.square(np.asarray(sigmas, dtype=np.float64))
    mean = float(np.sum(weight * value) / np.sum(weight))
    off = float(np.sum(weight * (value - mean) ** 2))
    passed = off < float(chi2.isf(CHANCE, len(value) - 1))
    usual, scatter = float(np.sqrt(np.mean(1 / weight))), float(np.std(value, ddof=1))
    message = (
        f"the {what} of {len(value)} views scatters by {scatter:.3g} {unit}, their doubts explain {usual:.2g} {unit}"
    )
    ending = "." if passed else ": do all of them show the same one, as it was?"
    return Check("views_agree", passed, scatter / usual, 1.0, message + ending)
