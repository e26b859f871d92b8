"""Scatter from repetition to repetition that is larger than in a usual experiment.

The baseline takes up any scatter, so that no effect is named for it; a large one is a finding of its own: something
differs from repetition to repetition that the lab takes for the same.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from rigtwin.compare.diagnose.fitting.fit import Fit
from rigtwin.compare.diagnose.fitting.normal_equations import Bench
from rigtwin.lab.formatting import unit_of

AT_LEAST = 3  # repetitions in which a quantity is seen, so that there is a scatter


def scatter_found(bench: Bench, fitted: Fit) -> list[dict[str, Any]]:
    """Name, unit, standard deviation and usual limit of each quantity that differs between repetitions."""
    seen = [int((bench.scatter == number).sum()) for number in range(len(bench.scattered))]
    return [
        {"name": one.name, "unit": one.unit, "std": float(std), "usual": one.usual}
        for one, std, count in zip(bench.scattered, fitted.scatter, seen, strict=True)
        if count >= AT_LEAST
    ]


def above_usual(rows: Sequence[Mapping[str, Any]]) -> list[Mapping[str, Any]]:
    """The rows of `scatter_found` above their usual limit, the furthest above first."""
    far = [row for row in rows if row["std"] > row["usual"]]
    return sorted(far, key=lambda row: -row["std"] / row["usual"])


def in_words(rows: Sequence[Mapping[str, Any]]) -> str:
    """One sentence on the quantities that scatter too much; empty if none does."""
    each = ", ".join(
        f"{row['name']} by {row['std']:.2g}{unit_of(row['unit'])} (usual: below {row['usual']:.2g})" for row in rows
    )
    return f"the repetitions scatter more than usual: {each}" if rows else ""
