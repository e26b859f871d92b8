"""Whether several views show one and the same thing: their numbers scatter no more than their doubts allow."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rigtwin.lab.quantity import Check

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
