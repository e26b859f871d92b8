"""Outline of a bed across its cylinder: record of one view, mean and roughness, and search for straight edges."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from rigtwin.lab.arrays import Array
from rigtwin.lab.errors import NothingToMeasure
from rigtwin.lab.records import Profile

# Factor by which a millimetre of the gauge may be larger or smaller than expected.  It is wide because the gauge is
# also used to check the stated size from which the expectation comes.
PITCH_RANGE = 2.2

# Height of the mean outline above the mean top of the surface beads, in bead diameters, and its standard uncertainty.
# The value comes from settled beds of a DEM, 8 to 13 bead diameters wide, with several frictions.  The uncertainty is
# that of layers drawn at random (benchmarks/measure/bulk_coverage.py): 0.067 from bed to bed, 0.05 in the middle.
OUTLINE_ABOVE, OUTLINE_SPREAD = 0.30, 0.08

READ = 0.95  # share of the inner radius that is read: at the wall the outline falls with the side of the last bead

ROUGHEST = 0.6  # [bead diameters], largest rms roughness; outlines of settled beds of a DEM have 0.15 to 0.35

SAME_PLANE = 0.02  # largest relative difference of the two scales if the gauge stands in the plane of the axis

NEARER = 1.05  # beads in front are nearer to the camera than the axis by about 1/15, beads at the sides less

SMOOTHEST = 0.03  # [bead diameters], least roughness; a straight edge reads a third of a pixel if beads have a dozen

# An outline with more than the share `ON_A_LINE` of its points within `LINE_WIDTH` bead diameters of one line is an
# edge of something in front of the bed.  Of round bead tops at most a third of the points do so.
ON_A_LINE, LINE_WIDTH = 0.5, 0.03

ANCHORS = 40  # points through pairs of which lines are tried


@dataclass(frozen=True)
class Observation:
    """Outline of one view with the uncertainties that the picture leaves."""

    profile: Profile
    uncertainties: dict[str, float] = field(
        default_factory=dict
    )  # [m], named standard uncertainties of the mean height
    flaw: str = ""  # why the outline is unreliable
    misfit: str = ""  # why a stated size contradicts the picture
    unconfirmed: str = ""  # warning about a stated size that nothing in the picture confirms
    bead: float | None = None  # [m], apparent diameter of a bead


def inside_cylinder(profile: Profile, cylinder: float | None) -> tuple[Array, Array]:
    """Outline inside the cylinder, sorted by x: x and height, both shape (n,) [m]; n may be 0."""
    finite = np.isfinite(profile.height) & np.isfinite(profile.x)
    x, height = profile.x[finite], profile.height[finite]
    if cylinder is not None:
        inside = np.abs(x) < READ * cylinder / 2
    elif len(x):
        reach = READ * float(np.ptp(x)) / 2
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
            f"profile {profile.view!r} has {len(x)} points of known height inside the cylinder, 8 are needed; give x_m "
            "from the axis and height_m above the floor, or state the walls of a photo with --cylinder x1,y1,x2,y2."
        )
    # resample in equal steps: a profile may have more points in some places
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
