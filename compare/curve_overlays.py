"""Overlays of measured and simulated curves (profiles, discharge, trajectories) and their distance.

"It is always advisable to make an overall visual comparison of the slope shape between the calibration simulation and
the experimental curves" (Hlosta et al. 2020, section 5).  A scalar may agree where the shapes do not: a pile with a
round tip and one with a hollow flank can have the same angle.

All curves are interpolated to a common axis, and repetitions (or views, or times) are averaged on it.  The distance is
the root mean square of the difference of the two means where both are known.  The scatter of the single measured curves
about their mean is given beside it: a smaller distance is no disagreement.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from rigtwin.lab.arrays import Array
from rigtwin.lab.quantity import Measurement
from rigtwin.lab.records import Profile, Series, Track

GRID = 400  # points of the common axis
STEADY = 0.5  # share of a drum's film after which its surface counts as steady
INSIDE = (
    0.95  # share of the radius of a drum or cylinder that is compared; at the wall an outline follows the last bead
)


@dataclass(frozen=True)
class Curve:
    """One repetition, view or moment."""

    x: Array
    y: Array  # NaN where it is not known


@dataclass(frozen=True)
class Overlay:
    """Measured and simulated curves of one quantity, on common axes."""

    what: str  # "profile", "discharge", "height of the bead" ...
    x_label: str
    y_label: str
    unit: str  # of y
    measured: tuple[Curve, ...]
    simulated: tuple[Curve, ...]
    bead: float | None = None  # bead diameter in the unit of y, where y is a length
    to_scale: bool = False

    @property
    def span(self) -> tuple[float, float]:
        """The range of x in which both sides are known."""
        low = max(min(_known(curve)[0] for curve in side) for side in (self.measured, self.simulated))
        high = min(max(_known(curve)[1] for curve in side) for side in (self.measured, self.simulated))
        return low, high

    @property
    def meet(self) -> bool:
        """Whether there is a range of x in which both sides are known."""
        low, high = self.span
        return high > low and math.isfinite(self.distance)

    def mean(self, curves: Sequence[Curve]) -> Curve:
        """Return the mean over curves on the common axis.

        Parameters
        ----------
        curves : sequence of Curve
            The curves, in the units of the overlay.

        Returns
        -------
        Curve
            The mean at `GRID` points of `span`; NaN where no curve is known.
        """
        x = np.linspace(*self.span, GRID)
        rows = np.array([_at(curve, x) for curve in curves])
        known = np.isfinite(rows)
        count = known.sum(axis=0)
        total = np.where(known, rows, 0.0).sum(axis=0)
        return Curve(x, np.where(count > 0, total / np.maximum(count, 1), np.nan))

    @property
    def distance(self) -> float:
        """Root mean square of simulated minus measured mean [`unit`]."""
        return _rms(self.mean(self.simulated).y - self.mean(self.measured).y)

    @property
    def offset(self) -> float:
        """Mean of simulated minus measured mean [`unit`]: the part of the distance due to a shift."""
        return float(np.mean(_finite(self.mean(self.simulated).y - self.mean(self.measured).y)))

    def scatter(self, curves: Sequence[Curve]) -> float | None:
        """Return the root mean square of single curves about their mean.

        Parameters
        ----------
        curves : sequence of Curve
            The curves, in the units of the overlay.

        Returns
        -------
        float or None
            Root mean square [`unit`]; None for a single curve.
        """
        if len(curves) < 2:
            return None
        mean = self.mean(curves)
        return _rms(np.concatenate([_at(curve, mean.x) - mean.y for curve in curves]))

    def row(self, experiment: str) -> dict[str, Any]:
        """Return a row of the table of shapes.

        Parameters
        ----------
        experiment : str
            Name of the experiment.

        Returns
        -------
        dict
            The cells by column, lengths in the unit of the overlay.
        """
        return {
            "experiment": experiment,
            "shape": self.what,
            "unit": self.unit,
            "distance_rms": self.distance,
            "offset": self.offset,
            "distance_bead_diameters": None if self.bead is None else self.distance / self.bead,
            "scatter_measured": self.scatter(self.measured),
            "scatter_simulated": self.scatter(self.simulated),
            "measured_n": len(self.measured),
            "simulated_n": len(self.simulated),
        }


def comparable(found: Iterable[Overlay]) -> tuple[Overlay, ...]:
    """Return the overlays that have both sides, with a range of x in which both are known.

    Parameters
    ----------
    found : iterable of Overlay
        Overlays, some perhaps with one side only.

    Returns
    -------
    tuple of Overlay
        In their order.
    """
    return tuple(shape for shape in found if shape.measured and shape.simulated and shape.meet)


# ---------------------------------------------------------------------- curves of the rigs
# `measured` are the measurements of an experiment, `twins` the runs of its twin; either side may have no such record


def height_over_time(measured: Sequence[Measurement], twins: Sequence[Any], bead: float) -> Iterable[Overlay]:
    """Overlay the height of a bead [mm] over the time from its first contact [s].

    Parameters
    ----------
    measured : sequence of Measurement
        Measurements of an experiment; those without a track are left out.
    twins : sequence of Twin
        Runs of its twin, likewise.
    bead : float
        Diameter of the bead [m].

    Yields
    ------
    Overlay
        One, which may have empty sides.
    """

    def curves(side: Sequence[Any]) -> tuple[Curve, ...]:
        return tuple(_since_contact(one.tracks[0]) for one in side if one.tracks)

    yield Overlay(
        "height of the bead",
        "time from the first contact / s",
        "height above the plate / mm",
        "mm",
        curves(measured),
        curves(twins),
        bead * 1e3,
    )


def angles_over_time(
    measured: Sequence[Measurement], twins: Sequence[Any], length: float, bead: float
) -> Iterable[Overlay]:
    """Overlay the angle of each bead of a pendulum [deg] over the time from the collision [s].

    Parameters
    ----------
    measured, twins : sequence of Measurement, sequence of Twin
        As for `height_over_time`.
    length : float
        From the pivot to the centre of the bead [m].
    bead : float
        Diameter of the beads [m].

    Yields
    ------
    Overlay
        One for each bead that both sides have.
    """
    sides = [[_angles(one.tracks, length, bead) for one in side if one.tracks] for side in (measured, twins)]
    for number, body in enumerate("AB"):
        mine, theirs = (tuple(angles[number] for angles in side if len(angles) > number) for side in sides)
        if mine and theirs:
            yield Overlay(
                f"angle of bead {body}",
                "time from the collision / s",
                "angle from the vertical / °",
                "deg",
                mine,
                theirs,
            )


def way_over_angle(measured: Sequence[Measurement], twins: Sequence[Any], bead: float) -> Iterable[Overlay]:
    """Overlay the displacement of a body down a plate [mm] over the angle of the plate [deg].

    Parameters
    ----------
    measured, twins : sequence of Measurement, sequence of Twin
        As for `height_over_time`; they need a series of the angle, too.
    bead : float
        Diameter of the body [m].

    Yields
    ------
    Overlay
        One, which may have empty sides.
    """

    def curves(side: Sequence[Any]) -> tuple[Curve, ...]:
        return tuple(_down_the_plate(one.series[0], one.tracks[0]) for one in side if one.series and one.tracks)

    yield Overlay(
        "way down the plate",
        "angle of the plate / °",
        "way of the body / mm",
        "mm",
        curves(measured),
        curves(twins),
        bead * 1e3,
    )


def share_left_over_time(measured: Sequence[Measurement], twins: Sequence[Any]) -> Iterable[Overlay]:
    """Overlay the share of the filling that is left in a hopper [%] over the time from the opening [s].

    Parameters
    ----------
    measured, twins : sequence of Measurement, sequence of Twin
        Measurements of an experiment and runs of its twin; those without a series are left out.

    Yields
    ------
    Overlay
        One, which may have empty sides.
    """

    def share(left: Series, opened: float) -> Curve:
        return Curve(left.time - opened, 100 * left.value / float(np.nanmax(left.value)))

    yield Overlay(
        "discharge",
        "time from the opening / s",
        "left in the hopper / %",
        "%",
        tuple(share(one.series[0], _opening(one)) for one in measured if one.series),
        tuple(share(one.series[0], 0.0) for one in twins if one.series),
    )


def mean_surface(
    measured: Sequence[Measurement], twins: Sequence[Any], diameter: float, bead: float
) -> Iterable[Overlay]:
    """Overlay the mean surface of the steady bed in a drum: height over distance from the axis [mm].

    The later half of the profiles of each run is averaged; a surface that rises to the right is mirrored.

    Parameters
    ----------
    measured, twins : sequence of Measurement, sequence of Twin
        Measurements of an experiment and runs of its twin; those without profiles are left out.
    diameter : float
        Diameter of the drum [m].
    bead : float
        Diameter of the beads [m].

    Yields
    ------
    Overlay
        One, which may have empty sides.
    """
    reach = INSIDE * diameter / 2

    def steady(profiles: Sequence[Profile]) -> Curve:
        x = np.linspace(-reach, reach, GRID)
        late = profiles[int(STEADY * len(profiles)) :]
        rows = np.array([_at(Curve(one.x, one.height), x) for one in late])
        # at the edge of the bed, which moves, only positions that are seen at most times
        often = np.isfinite(rows).mean(axis=0) > 0.5
        mean = np.where(often, np.nanmean(np.where(often, rows, 0.0), axis=0), np.nan)
        known = np.isfinite(mean)
        falls = known.any() and np.polyfit(x[known], mean[known], 1)[0] < 0
        # the drum may turn either way: mirror the surface so that it falls to the right
        return Curve(x, mean if falls else mean[::-1])

    yield Overlay(
        "mean surface of the bed",
        "distance from the axis / mm",
        "height from the axis / mm",
        "mm",
        tuple(_in_mm(steady(one.profiles)) for one in measured if one.profiles),
        tuple(_in_mm(steady(one.profiles)) for one in twins if one.profiles),
        bead * 1e3,
        to_scale=True,
    )


def outlines(
    what: str, measured: Sequence[Measurement], twins: Sequence[Any], bead: float, width: float | None = None
) -> Iterable[Overlay]:
    """Overlay outlines about their middle: height over distance from it [mm].

    Parameters
    ----------
    what : str
        Name of the overlay.
    measured, twins : sequence of Measurement, sequence of Twin
        Measurements of an experiment and runs of its twin, each with any number of profiles.
    bead : float
        Diameter of the beads [m].
    width : float, optional
        Diameter of a vessel around them [m]; the outermost 5 % are then left out.

    Yields
    ------
    Overlay
        One, which may have empty sides.
    """

    def curves(side: Sequence[Any]) -> tuple[Curve, ...]:
        found = [_in_mm(_centred(profile)) for one in side for profile in one.profiles]
        if width is None:
            return tuple(found)
        return tuple(Curve(c.x, np.where(np.abs(c.x) < INSIDE * width / 2 * 1e3, c.y, np.nan)) for c in found)

    yield Overlay(
        what,
        "distance from the middle / mm",
        "height above the base / mm",
        "mm",
        curves(measured),
        curves(twins),
        bead * 1e3,
        to_scale=True,
    )


# ---------------------------------------------------------------------- records to curves


def _since_contact(track: Track) -> Curve:
    """Time [s] and height [mm] from the first contact, the intersection of lines through the frames before and after.

    The origin of a record is arbitrary (plate, contact, or a choice of the tracking program).
    """
    time, height = track.time, track.position[:, 1]
    span = float(np.ptp(height))
    low = int(np.argmax(height < np.min(height) + 0.15 * span))
    turn = low + int(np.argmax(np.diff(height[low:], append=np.inf) > 0))
    before, after = slice(max(turn - 3, 0), turn), slice(turn + 1, turn + 4)
    if len(time[before]) < 2 or len(time[after]) < 2:
        return Curve(np.asarray(time - time[turn]), np.asarray((height - height[turn]) * 1e3))
    down, up = np.polyfit(time[before], height[before], 1), np.polyfit(time[after], height[after], 1)
    contact = (up[1] - down[1]) / (down[0] - up[0])
    return Curve(np.asarray(time - contact), np.asarray((height - np.polyval(down, contact)) * 1e3))


def _angles(tracks: Sequence[Track], length: float, diameter: float) -> list[Curve]:
    """For each bead: time from the first collision [s] and angle [deg], from the horizontal distance to the pivot."""
    from rigtwin.measure.geometry.circle import fit_circle

    first = tracks[0]
    (pivot, _), _ = fit_circle(first.position)
    side = 1.0 if float(first.position[0, 0]) < pivot else -1.0
    angles = [
        np.degrees(np.arcsin(np.clip(side * (track.position[:, 0] - pivot) / length - shift, -1, 1)))
        for track, shift in zip(tracks, (0.0, diameter / length), strict=False)
    ]
    hit = float(first.time[int(np.argmax(angles[0] > -0.5))])
    return [Curve(track.time - hit, angle) for track, angle in zip(tracks, angles, strict=False)]


def _down_the_plate(angle: Series, track: Track) -> Curve:
    """Angle of the plate [deg] and displacement of the body down the plate [mm]."""
    known = np.isfinite(angle.value)
    turned = np.interp(track.time, angle.time[known], np.asarray(angle.value)[known])
    turned = np.radians(turned) if angle.unit == "deg" else turned
    up = track.position[:, 0] * np.cos(turned) + track.position[:, 1] * np.sin(turned)
    return Curve(np.degrees(turned), -(up - np.median(up[: max(3, len(up) // 20)])) * 1e3)


def _opening(item: Measurement) -> float:
    """Opening time [s] as measured, else the first time of the record."""
    found = [one.value for one in item.quantities if one.quantity == "opening_time" and math.isfinite(one.value)]
    return found[0] if found else float(item.series[0].time[0])


def _centred(profile: Profile) -> Curve:
    return Curve(profile.x - middle(profile), profile.height)


def middle(profile: Profile) -> float:
    """Return the middle of the base, or of the visible profile if the base is not known.

    Parameters
    ----------
    profile : Profile
        Profile of a heap or bed.

    Returns
    -------
    float
        Its x [m]; 0 if nothing is visible.
    """
    if profile.base is not None:
        return sum(profile.base) / 2
    seen = np.isfinite(profile.height) & (profile.height > 0)
    return float(np.mean(profile.x[seen][[0, -1]])) if np.any(seen) else 0.0


def _in_mm(curve: Curve) -> Curve:
    return Curve(curve.x * 1e3, curve.y * 1e3)


# ---------------------------------------------------------------------- curves


def _known(curve: Curve) -> tuple[float, float]:
    x = curve.x[np.isfinite(curve.y) & np.isfinite(curve.x)]
    return (float(x.min()), float(x.max())) if len(x) else (math.inf, -math.inf)


def _at(curve: Curve, x: Array) -> Array:
    """The curve interpolated at `x`; NaN outside it and in gaps wider than a fiftieth of its length."""
    known = np.isfinite(curve.y) & np.isfinite(curve.x)
    if known.sum() < 2:
        return np.full(len(x), np.nan)
    order = np.argsort(curve.x[known], kind="stable")
    at, value = curve.x[known][order], curve.y[known][order]
    found = np.interp(x, at, value, left=np.nan, right=np.nan)
    after = np.clip(np.searchsorted(at, x), 1, len(at) - 1)
    wide = max(float(np.ptp(at)) / 50, 3 * float(np.median(np.diff(at))))
    return np.where(at[after] - at[after - 1] > wide, np.nan, found)


def _finite(values: Array) -> Array:
    return values[np.isfinite(values)]


def _rms(values: Array) -> float:
    """Root mean square of the finite values; NaN if there are none."""
    known = _finite(values)
    return float(np.sqrt(np.mean(known**2))) if len(known) else math.nan
