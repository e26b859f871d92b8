"""Calibration quantities that a fit moves far from their stated values.

The priors of the calibration keep an effect from explaining a calibration error.  Where the data pull a quantity by
many of its stated standard uncertainties, the fit has not calibrated: it has covered a disagreement.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from rigtwin.compare.diagnose.fitting.fit import Fit

STRAINED = 5.0  # pull beyond which a quantity is reported; by chance 6e-7 for one Gaussian quantity
LISTED = 4  # largest number of quantities that the sentence names


def calibration(fitted: Fit) -> list[dict[str, Any]]:
    """Value, standard uncertainty, stated standard uncertainty and pull of each unknown of the baseline.

    The stated uncertainty and the pull (fitted less stated value over the stated uncertainty) are None where nothing is
    stated.
    """
    return [
        {
            "name": u.name,
            "value": float(v),
            "std": fitted.std(u.name),
            "stated_std": u.sd if math.isfinite(u.sd) else None,
            "pull": fitted.pulls.get(u.name),
        }
        for u, v in zip(fitted.unknowns, fitted.values, strict=True)
        if not u.effect
    ]


def strained(rows: Sequence[Mapping[str, Any]]) -> list[Mapping[str, Any]]:
    """The rows of `calibration` with a pull beyond `STRAINED`, largest first."""
    far = [row for row in rows if row["pull"] is not None and abs(row["pull"]) > STRAINED]
    return sorted(far, key=lambda row: -abs(row["pull"]))


def in_words(rows: Sequence[Mapping[str, Any]]) -> str:
    """One sentence on strained quantities; empty if there are none."""
    if not rows:
        return ""
    each = ", ".join(
        f"{row['name']} by {abs(row['pull']):.0f} ({row['value']:.3g}, stated ± {row['stated_std']:.2g})"
        for row in rows[:LISTED]
    )
    more = f" and {len(rows) - LISTED} more" if len(rows) > LISTED else ""
    what = "a calibration quantity" if len(rows) == 1 else f"{len(rows)} calibration quantities"
    return (
        f"the fit pulls {what} by more than {STRAINED:g} stated standard uncertainties: {each}{more}; this is no "
        "calibration but a disagreement, or the baseline lacks something ordinary"
    )
