"""Checks of the bead size and of the agreement between views of one heap or bed."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from rigtwin.lab.quantity import Check

# relative limit for the apparent size of single beads: shaded rims are soft, and their measured size scatters by 0.04
# from photo to photo for all tested blur, noise and light
MISFIT = 0.16


# distance of neighbours in bead diameters as seen in the outermost layers of a settled bed, where not all beads touch
# or lie at the same depth; and its relative standard uncertainty
NEIGHBOURS, NEIGHBOURS_UNCERTAINTY = 1.08, 0.05


def size_seen(seen: float, stated: float, most: float, scale_from: str) -> Check:
    """Check `bead_size`: the diameter `seen` must differ from the `stated` one [m] by less than `most` of it."""
    ratio = seen / stated
    passed = abs(ratio - 1) < most
    usual = f"{max(1 - most, 0):.2f} to {1 + most:.2f} is accepted"
    ending = "." if passed else f": check --bead-diameter and the scale (from {scale_from})."
    sizes = f"{seen * 1e3:.3g} mm by the scale, {stated * 1e3:.4g} mm stated"
    message = f"beads look {ratio:.2f} times as large as stated ({sizes}); {usual}{ending}"
    return Check("bead_size", passed, ratio, 1.0, message)


def size_of_beads(spacing: float) -> float:
    """Bead diameter from the distance of neighbours, in the same unit.

    >>> round(size_of_beads(10.8), 3)
    10.0
    """
    return spacing / NEIGHBOURS


def spacing_check(spacing: float, uncertainty: float, bead: float, scale_from: str) -> Check:
    """Check `bead_size` by the distance of neighbours `spacing` in a bed; it and the stated `bead` diameter in m.

    `uncertainty` is the relative standard uncertainty of the scale.
    """
    most = 3 * math.hypot(uncertainty, NEIGHBOURS_UNCERTAINTY)
    return size_seen(size_of_beads(spacing), bead, most, scale_from)


def size_unseen(what: str, given: str, advice: str) -> str:
    """The warning that all lengths depend on one stated size that nothing found in the picture confirms."""
    return f"size not confirmed: {what} on {given} alone, and nothing found in the picture checks it; {advice}."


CHANCE = 1e-3  # significance level of the chi-squared test


def views_check(what: str, values: Sequence[float], sigmas: Sequence[float], unit: str) -> Check:
    """Check `views_agree`: `values` of `what`, one per view, agree within `sigmas`.

    `sigmas` are the uncertainty components that the views do not share. The weighted sum of squares about the weighted
    mean is tested against the chi-squared distribution.
    """
    from scipy.special import chdtrc  # importing all of scipy.stats takes longer than evaluating a bed

    value, weight = np.asarray(values, dtype=np.float64), 1 / np.square(np.asarray(sigmas, dtype=np.float64))
    mean = float(np.sum(weight * value) / np.sum(weight))
    off = float(np.sum(weight * (value - mean) ** 2))
    chance = float(chdtrc(len(value) - 1, off))
    passed = chance > CHANCE
    usual, scatter = float(np.sqrt(np.mean(1 / weight))), float(np.std(value, ddof=1))
    message = (
        f"the {what} of {len(value)} views scatters by {scatter:.3g} {unit}, their uncertainties explain "
        f"{usual:.2g} {unit}; by chance it is at least as large in {100 * chance:.1f} % of cases"
    )
    ending = "." if passed else ": check that all of them show the same one, unchanged."
    return Check("views_agree", passed, scatter / usual, 1.0, message + ending)
