"""Quantities that differ between repetitions, and how much is usual."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

from rigtwin.lab.reference import hlosta2020

STANDARD_DEVIATIONS = {  # columns with published standard deviations of repetitions, by table
    "restitution": ((11, "e_pw_std"), (12, "e_pp_std")),
    "static_friction": ((8, "mu_s_pw_std"), (9, "mu_s_pp_std")),
    "rolling_friction": ((10, "mu_r_pw_std"),),
}


@dataclass(frozen=True)
class Scattered:
    """A quantity that differs from repetition to repetition, or from impact to impact."""

    name: str
    unit: str
    usual: float
    """Largest standard deviation that is usual, in the unit."""


def of_pairs(name: str, pairs: Sequence[str]) -> list[Scattered]:
    """A coefficient of each pair, with the largest published scatter as the usual limit."""
    usual = largest_published(name)
    return [Scattered(f"{name.replace('_', ' ')} of {pair}", "1", usual) for pair in pairs]


@cache
def largest_published(coefficient: str) -> float:
    """Largest published standard deviation [1] of a coefficient between repetitions (Hlosta et al. 2020).

    >>> largest_published("static_friction")
    0.08
    """
    return max(
        float(row[column] or 0.0)
        for table, column in STANDARD_DEVIATIONS[coefficient]
        for row in hlosta2020.table(table)
    )
