from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from rigtwin.lab.arrays import Array
from rigtwin.lab.errors import NothingToMeasure
from rigtwin.lab.records import Profile

# How far the mean outline stands above the mean top of the surface beads, and the mean surface with its pits below it,
# in bead diameters; from settled beds of a DEM, of 8 to 13 bead diameters' width and of several frictions.
# The spread is that of layers drawn at random (benchmarks/measure/bulk_coverage.py): 0.067 from bed to bed,
# 0.05 in the middle.
OUTLINE_ABOVE, OUTLINE_SPREAD = 0.30, 0.08

INSIDE = 0.95  # share of the inner radius that is read: at the wall the outline falls with the last bead's side

ROUGHEST = 0.6  # bead diameters; outlines of settled beds of a DEM are rough by 0.15 to 0.35

SMOOTHEST = 0.03  # likewise; a straight edge is read to a third of a pixel where beads are a dozen pixels wide

# of beads' round tops at most a third lies on one line, within that many bead diameters; of an edge in front, most
ON_A_LINE, LINE_WIDTH = 0.5, 0.03

ANCHORS = 40  # places through which lines are tried


@dataclass(frozen=True)
class Observation:
    """One photo's outline and what the picture leaves in doubt [m]."""

    profile: Profile
    doubts: dict[str, float] = field(default_factory=dict)  # of the mean height
    flaw: str = ""  # why the outline is not to be relied on
    misfit: str = ""  # what speaks against a stated size
    unconfirmed: str = ""  # the stated size on which all hangs and which nothing in the picture checks
    bead: float | None = None  # [m], as large as beads look


def inside_cylinder(profile: Profile, cylinder: float | None) -> tuple[Array, Array]:
    """The outline where it is read, rising in x [m]; too little of it to read is possible."""
    finite = np.isfinite(profile.height) & np.isfinite(profile.x)
    x, height = profile.x[finite], profile.height[finite]
    if cylinder is not None:
        inside = np.abs(x) < INSIDE * cylinder / 2
    elif len(x):
        reach = INSIDE * float(np.ptp(x)) / 2
        inside = np.abs(x - (x.max() + x.min()) / 2) < reach
    else:
        inside = np.zeros(0, dtype=bool)
    order = np.argsort(x[inside])
    return x[inside][order], height[inside][order]


def mean_outline(profile: Profile, cylinder: float | None) -> tuple[float, float]:
    """Mean height of the outline inside the cylinder and its roughness about a slope, both in m."""
    x, height = inside_cylinder(profile, cylinder)
    if len(x) < 8 or np.ptp(x) <= 0:
        raise NothingToMeasure(
            f"profile {profile.view!r} shows too little of the bed's surface inside the cylinder; "
            "give x_m from the axis and height_m above the floor."
        )
    # even steps: a profile may be denser at some places
    places = np.linspace(x.min(), x.max(), 400)
    level = np.interp(places, x, height)
    return float(level.mean()), float(np.std(level - np.polyval(np.polyfit(places, level, 2), places)))


def on_a_line(x: Array, height: Array, width: float) -> float:
    """Largest share of the points that lie within `width` of one straight line."""
    ends = np.unique(np.linspace(0, len(x) - 1, ANCHORS).round().astype(int))
    first, second = (ends[k] for k in np.triu_indices(len(ends), k=1))
    apart = x[second] - x[first]
    first, second = first[apart > 4 * width], second[apart > 4 * width]
    slope = (height[second] - height[first]) / (x[second] - x[first])
    off = height - height[first, None] - slope[:, None] * (x - x[first, None])
    return float(np.max(np.mean(np.abs(off) < width, axis=1), initial=0.0))
