"""Evaluate the track of a bouncing bead: drop and rebound heights, restitution per bounce, checks."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from rigtwin.lab.arrays import Array
from rigtwin.lab.errors import NothingToMeasure
from rigtwin.lab.quantity import Detail, Evaluation, Quantity, doubted, root_sum_of_squares
from rigtwin.lab.records import Track
from rigtwin.measure.drop.bounce_fit import Bounces, Heights, Reader, find_contacts, fit_bounces, third_difference_noise
from rigtwin.measure.drop.checks import (
    fall_check,
    gravity_check,
    plane_check,
    residual_check,
    timing_check,
)
from rigtwin.measure.drop.fall_in_air import AirDrag
from rigtwin.measure.drop.lost_frames import find_losses
from rigtwin.measure.media.frame_loss import Loss, in_time, repeated

# checks on which heights depend
HEIGHTS_REST_ON = ("first_fall", "lost_frames", "gravity", "flight_residuals", "out_of_plane")

GAIN = "a restitution above 1 is not possible: the track is wrong there"

FEWEST = 12  # positions of a track; bounces are fitted to more

CLOCK = 0.01  # standard uncertainty of the time of a frame over the frame interval: clock, begin of the exposure

ONE_VIEW = "seen from one side: motion along the line of sight is not measured"

SPUN = "the body leaves the plate faster than it came down: its spin adds to the rebound, which is no restitution"


# ------------------------------------------------------------------------------------------------- record -> quantities


def evaluate(
    track: Track,
    *,
    side: Track | None = None,
    bead_diameter: float | None = None,
    bead_density: float | None = None,
) -> Evaluation:
    """Evaluate the track of a bouncing body, filmed or simulated.

    Parameters
    ----------
    track : Track
        Position [m], shape (n, 2), y up against gravity; time [s], shape (n,).  A `sigma` of NaN means unknown: the
        noise is then taken from the residuals.
    side : Track, optional
        The same body at the same times seen from the side: its x points away from the viewer of `track`.
    bead_diameter, bead_density : float, optional
        Diameter [m] and density [kg/m^3], which fix the air drag; without both of them its strength is fitted.

    Returns
    -------
    Evaluation
        ``drop_height`` [m], and per bounce ``rebound_height`` [m] and ``restitution_wall`` [1] by several methods.

    Raises
    ------
    NothingToMeasure
        If the track has no bounce with a free flight before and after it.

    Notes
    -----
    Methods of ``restitution_wall`` at bounce k:

    - ``height``: sqrt(h_k / h_{k-1}) with the apex heights h; air drag lowers it.
    - ``velocity``: ratio of the speeds normal to the plate just after and just before the contact.
    - ``time``: ratio of neighbouring flight times, from the second bounce on.
    - ``all directions``: ratio of the total speeds (with `side`); ``picture plane``: the same from one view.  Both are
      for bodies that leave sideways, as non-spherical ones do (section 3.2).

    References
    ----------
    Hlosta et al. (2020), eq. 5 and section 3.2.

    Examples
    --------
    A fall from 0.5 m with three rebounds at e = 0.8, without air:

    >>> import numpy as np
    >>> flights, impact, height, speed = [], (2 * 0.5 / 9.81) ** 0.5, 0.5, 9.81 * (2 * 0.5 / 9.81) ** 0.5
    >>> time = np.arange(0, 1.6, 1 / 240)
    >>> y = 0.5 - 9.81 * time**2 / 2
    >>> for _ in range(3):
    ...     speed *= 0.8
    ...     since = time - impact
    ...     y = np.where(since > 0, speed * since - 9.81 * since**2 / 2, y)
    ...     impact += 2 * speed / 9.81
    >>> seen = time < impact
    >>> track = Track(time[seen], np.column_stack([0 * y, y])[seen], np.full(int(seen.sum()), np.nan))
    >>> found = evaluate(track).quantities
    >>> e = next(each for each in found if each.method == "velocity" and each.detail["bounce"] == 1)
    >>> bool(abs(e.value - 0.8) < 0.01)
    True
    """
    rate = rate_of(track)
    drag = AirDrag(bead_diameter, bead_density)
    whole = track
    track, repeats, losses, fitted = readable(track, drag)
    if side is not None:  # a rotating body touches the plate at different heights, which looks like lost frames
        track, losses, fitted = whole, (), None
    bounces = bounces_of(track, drag, str(track.body), fitted=fitted, in_metres=True)
    return evaluate_bounces(track, bounces, side=side, scale_uncertainty=0.0, rate=rate, repeats=repeats, losses=losses)


def readable(track: Track, drag: AirDrag) -> tuple[Track, int, tuple[Loss, ...], Bounces | None]:
    """The track without NaN points and repeated frames, the number of repeats, lost frames, and its bounces.

    The times are corrected for frames that were lost for certain.
    """
    finite = np.isfinite(track.time) & np.all(np.isfinite(track.position), axis=1)
    time, position = track.time[finite], track.position[finite]
    again = np.zeros(len(time), dtype=bool)
    if len(time) > 12:
        steps = np.diff(position, axis=0)
        onwards = np.sum(steps[:-2] * steps[2:], axis=1) > 0  # not where the bead turns round
        lengths = np.hypot(*steps.T)
        lengths[1:-1][~onwards] = np.max(lengths)
        again[1:] = repeated(lengths)
    kept = Track(time[~again], position[~again], track.sigma[finite][~again], track.body)
    losses, fitted = find_losses(heights_of(kept), lambda record: fit(record, drag))
    return replace(kept, time=in_time(kept.time, losses)), int(np.sum(again)), losses, fitted


def rate_of(track: Track) -> float:
    """Frame rate [1/s]."""
    return 1 / float(np.nanmedian(np.diff(track.time))) if len(track.time) > 1 else math.nan


def bounces_of(
    track: Track,
    drag: AirDrag,
    name: str,
    *,
    fitted: Bounces | None = None,
    in_metres: bool = False,
    filmed: bool = False,
) -> Bounces:
    """The bounces of a track; `fitted` if they were fitted already.

    Raises `NothingToMeasure` if there is no bounce.
    """
    record = heights_of(track, filmed=filmed)
    if fitted is None and len(record.time) > FEWEST:
        fitted = fit(record, drag)
    if fitted is None:
        raise NothingToMeasure(f"{name}: {_why_no_bounce(record)}")
    if in_metres and drag.known and abs(fitted.read(lambda at: at.size)[0] - 1) > 0.2:
        # with a wrong scale or frame rate the known drag does not apply: fit it
        return fit_bounces(record, AirDrag()) or fitted
    return fitted


def heights_of(track: Track, *, filmed: bool = False) -> Heights:
    return Heights(track.time, track.position[:, 1], track.sigma, track.position[:, 0] if filmed else None)


def fit(record: Heights, drag: AirDrag) -> Bounces | None:
    """Fit with the known drag, or with a free one if that fails because the frame rate is wrong."""
    fitted = fit_bounces(record, drag)
    return fit_bounces(record, AirDrag()) if fitted is None and drag.known else fitted


def _why_no_bounce(record: Heights) -> str:
    count = len(record.time)
    stated = ", or state the bead with --bead-at frame:x,y" if record.across is not None else ""
    if count <= FEWEST:
        return (
            f"the bead has {count} positions, more than {FEWEST} are needed; give a record in which it falls and "
            f"bounces{stated}."
        )
    span = f"from {record.time[0]:.3f} to {record.time[-1]:.3f} s"
    rises, noise = float(np.ptp(record.height)), third_difference_noise(record)
    if rises <= 12 * noise:
        return (
            f"what was followed {span} moves up and down by {rises / max(noise, 1e-12):.1f} times the noise of its "
            f"position, more than 12 are needed; give a record in which the bead falls and bounces{stated}."
        )
    top, low = int(np.argmax(record.height)), int(np.argmin(record.height))
    contacts = record.time[find_contacts(record)]
    if len(contacts) == 0:
        return (
            f"what was followed {span} is highest at {record.time[top]:.3f} s and lowest at {record.time[low]:.3f} s, "
            "and no turn from falling to rising was found in its track; record it until it has bounced at least once, "
            f"turn a film that lies on its side, move --end{stated}."
        )
    steps = np.diff(record.time)
    lost = round(float(np.sum(steps / np.median(steps) - 1)))
    turns = ", ".join(f"{time:.3f}" for time in contacts[:4]) + (" ..." if len(contacts) > 4 else "")
    return (
        f"the track {span} turns from falling to rising at {turns} s, but no two flights of at least five positions "
        f"each, with a bounce between them, could be fitted to its {count} positions ({lost} frames between them "
        f"show none); move --start and --end to the fall and the bounces{stated}."
    )


def evaluate_bounces(
    track: Track,
    bounces: Bounces,
    *,
    side: Track | None = None,
    scale_uncertainty: float,
    rate: float,
    repeats: int,
    losses: tuple[Loss, ...],
) -> Evaluation:
    """Quantities and checks of fitted bounces.

    `repeats` is the number of repeated frames that were left out; certain `losses` are corrected in the times already.
    `rate` [1/s] is the frame rate, `scale_uncertainty` the relative standard uncertainty of the scale.
    """
    share = repeats / max(repeats + len(track.time), 1)
    checks = (
        gravity_check(bounces, scale_uncertainty, rate, share),
        residual_check(bounces),
        plane_check(track, bounces, side),
        fall_check(track, bounces),
        timing_check(track, bounces, repeats, losses),
    )
    failed = {check.check: check.message for check in checks if not check.passed}
    if not all(loss.sure for loss in losses):
        failed["lost_frames"] = failed["frame_timing"]
    along = [_Along(track, None, bounces)] if side is not None or "out_of_plane" in failed else []
    along += [] if side is None else [_Along(track, side, bounces)]
    turns = side is not None
    wrong_from = math.inf if turns else _wrong_from(bounces)
    quantities = [
        *_restitutions(bounces, failed, along, wrong_from, rate),
        *_heights(bounces, scale_uncertainty, failed, wrong_from),
    ]
    return Evaluation(tuple(quantities), checks)


class _Along:
    """Speed along the plate before and after each bounce, in units of the record per second."""

    def __init__(self, track: Track, side: Track | None, bounces: Bounces) -> None:
        self.method = "picture plane" if side is None else "all directions"
        contacts = bounces.contact_times
        starts = [float(track.time[0]), *contacts]
        ends = [*contacts, float(track.time[-1])]
        places = [track.position[:, 0], *([] if side is None else [side.position[:, 0]])]
        flights = [
            bounces.used & (track.time > start) & (track.time < end) for start, end in zip(starts, ends, strict=True)
        ]
        lines = [[_slope(track.time[flight], x[flight]) for x in places] for flight in flights]
        self.speeds = [math.hypot(*(slope for slope, _ in line)) for line in lines]
        self.sigmas = [math.hypot(*(sigma for _, sigma in line)) for line in lines]


def _slope(time: Array, x: Array) -> tuple[float, float]:
    """Slope of a straight line [1/s] and its standard uncertainty, which is infinite for fewer than 4 points."""
    if len(time) < 4:
        return 0.0, math.inf
    (slope, _), covariance = np.polyfit(time - time.mean(), x, 1, cov=True)
    return float(slope), math.sqrt(float(covariance[0, 0]))


def _restitutions(
    bounces: Bounces, failed: dict[str, str], along: Sequence[_Along], wrong_from: float, rate: float
) -> list[Quantity]:
    reason = "; ".join(failed[name] for name in ("first_fall", "flight_residuals", "frame_timing") if name in failed)
    height_reason = "; ".join(text for text in (reason, failed.get("out_of_plane", "")) if text)
    speed_reason = reason
    if "gravity" in failed and abs(bounces.read(lambda at: at.size)[0] - 1) > 0.1:
        drag = "the air drag is not known, as scale or frame rate contradict gravity"
        speed_reason = "; ".join(text for text in (reason, drag) if text)
    found = []
    for k in range(1, bounces.count + 1):
        speed, parts = bounces.read(_impact_speed(k))
        detail: dict[str, Detail] = {
            "bounce": k,
            "impact_speed_m_s": round(speed, 6),
            "impact_speed_std_m_s": round(root_sum_of_squares(parts), 6),
            "contact_time_s": round(float(bounces.contact_times[k - 1]), 7),
        }
        by_height, by_speed = bounces.read(_height_ratio(k)), bounces.read(_speed_ratio(k))
        mine = [
            _quantity("restitution_wall", by_height, "1", "height", detail, height_reason),
            _quantity("restitution_wall", by_speed, "1", "velocity", detail, speed_reason),
        ]
        if k > 1:
            ratio, of_time = bounces.read(_time_ratio(k))
            # three contacts bound the two flights
            flight = float(bounces.model.reader(bounces.parameters).flight_times[k - 2])
            of_time["frame times"] = CLOCK / rate * math.hypot(1.0, 1 + ratio, ratio) / flight
            mine.append(_quantity("restitution_wall", (ratio, of_time), "1", "time", detail, height_reason))
        gains = GAIN if k >= wrong_from else SPUN if along and _gains(bounces, k) else ""
        found += [doubted(quantity, gains) for quantity in mine]
        found += [
            doubted(_with_speed_along(bounces, one, k, detail, speed_reason), GAIN if k >= wrong_from else "")
            for one in along
            if math.isfinite(one.sigmas[k - 1] + one.sigmas[k])
        ]
    return found


def _with_speed_along(bounces: Bounces, along: _Along, k: int, detail: dict[str, Detail], reason: str) -> Quantity:
    """Ratio of the total speeds after and before, including motion along the plate; rotation is not included."""
    before, after = along.speeds[k - 1], along.speeds[k]

    def ratio(at: Reader) -> float:
        return math.hypot(at.rebound_speed(k) * at.size, after) / math.hypot(at.impact_speed(k) * at.size, before)

    value, parts = bounces.read(ratio)
    fast = bounces.read(_impact_speed(k))[0] ** 2 + before**2
    parts["along the plate"] = math.hypot(after * along.sigmas[k] / value, value * before * along.sigmas[k - 1]) / fast
    if along.method == "picture plane":
        reason = "; ".join(text for text in (reason, ONE_VIEW) if text)
    return _quantity("restitution_wall", (value, parts), "1", along.method, detail, reason)


def _wrong_from(bounces: Bounces) -> float:
    """Number of the first bounce that is not reliable; infinite if all are.

    It is the one before the first bounce with a restitution above 1, because they share a contact; 0 means that the
    drop height is not reliable either.
    """
    return next((k - 1 for k in range(1, bounces.count + 1) if _gains(bounces, k)), math.inf)


def _gains(bounces: Bounces, bounce: int) -> bool:
    """Whether the restitution of a bounce is above 1 by more than two standard uncertainties."""
    value, parts = bounces.read(_speed_ratio(bounce))
    return value - 2 * root_sum_of_squares(parts) > 1


def _impact_speed(bounce: int) -> Callable[[Reader], float]:
    return lambda at: at.impact_speed(bounce) * at.size


def _height_ratio(bounce: int) -> Callable[[Reader], float]:
    """sqrt(h_{k+1} / h_k) (Hlosta et al. 2020, eq. 5)."""
    return lambda at: math.sqrt(at.heights[bounce] / at.heights[bounce - 1])


def _speed_ratio(bounce: int) -> Callable[[Reader], float]:
    return lambda at: at.rebound_speed(bounce) / at.impact_speed(bounce)


def _time_ratio(bounce: int) -> Callable[[Reader], float]:
    return lambda at: float(at.flight_times[bounce - 1] / at.flight_times[bounce - 2])


def _apex_height(bounce: int) -> Callable[[Reader], float]:
    return lambda at: float(at.heights[bounce]) * at.size


def _heights(bounces: Bounces, scale_uncertainty: float, failed: dict[str, str], wrong_from: float) -> list[Quantity]:
    reason = "; ".join(failed[name] for name in HEIGHTS_REST_ON if name in failed)
    found = []
    for k in range(bounces.count + 1):
        value, parts = bounces.read(_apex_height(k))
        if scale_uncertainty > 0:
            parts["scale"] = abs(value) * float(scale_uncertainty)
        name = "rebound_height" if k else "drop_height"
        detail: dict[str, Detail] = {"bounce": k} if k else {}
        height = _quantity(name, (value, parts), "m", "height", detail, reason)
        found.append(doubted(height, GAIN if k >= wrong_from else ""))
    return found


def _quantity(
    name: str,
    read: tuple[float, dict[str, float]],
    unit: str,
    method: str,
    detail: dict[str, Detail],
    doubtful: str,
) -> Quantity:
    value, parts = read
    found = Quantity(name, value, root_sum_of_squares(parts), unit, method, detail=dict(detail), budget=parts)
    return doubted(found, doubtful)
