"""Evaluate a discharge from what is left in the hopper over time: times, flow rate, residue, uncertainty budgets."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from rigtwin.lab.arrays import Array
from rigtwin.lab.errors import BadInput, NothingToMeasure
from rigtwin.lab.quantity import Check, Detail, Evaluation, Quantity, doubted, root_sum_of_squares
from rigtwin.lab.records import Series
from rigtwin.lab.units import positive
from rigtwin.measure.robust import mad_std

STEADY = (0.2, 0.8)  # shares of what leaves between which the flow is steady

# Standard uncertainty of an instant between two values, as a share of their interval.  It is chosen so that +-1.96 of
# it cover 95 % of the interval; the standard deviation, 1 / sqrt 12, would make intervals that always contain the
# truth.
WITHIN = 0.95 / (2 * 1.96)

CUT = "end of the record"

CUT_SHORT = (
    "beads still leave at the end of the record, so the discharge lasts longer than stated (a lower bound) and the "
    "empty hopper is not seen; give a longer record"
)

UNKNOWN_SHARE = 1 / math.sqrt(12)  # standard deviation of an unknown share, uniform between 0 and 1

FIRST_LOSS = 0.01  # share of the filling by which a measured value surely falls; below it a bed at rest may settle

TAIL = 0.02  # share of the discharge time without a loss at the record's end after which the flow has stopped

LASTING = 5  # values over which the median is taken: something may pass in one of them

REFILL = 0.1  # least rise, as a share of the filling: light and codec change the bed's area by some hundredths

BINS = 6  # parts of the steady flow whose rates give its scatter

STAYS = 0.7  # share of the bed left at the end above which there was no discharge

RESIDUE = 0.02  # residue above which the check fails

AT_ENDS = 0.25  # area uncertainty near the ends over that of the whole: little has loosened, or little is left


@dataclass(frozen=True)
class Instant:
    """An instant with its uncertainty budget."""

    time: float  # [s]
    budget: dict[str, float]  # [s], named standard uncertainties
    method: str
    doubtful: str = ""


def evaluate(left: Series, *, total_mass: float | None = None, opened: float | None = None) -> Evaluation:
    """Evaluate a discharge from what is left in the hopper over time, filmed or simulated.

    Parameters
    ----------
    left : Series
        What is left at each time [s]: a fraction, a mass [kg] or a number of particles, decreasing.  A particle counts
        as left until its centre is one radius below the outlet.
    total_mass : float, optional
        Mass of the filling [kg].
    opened : float, optional
        Time of the opening [s]; without it the first loss counts as the opening.

    Returns
    -------
    Evaluation
        ``opening_time``, ``last_particle_time``, ``discharge_time``, ``discharge_time_5_95`` [s], a flow rate and
        ``residue_fraction`` [1].  The rate is ``mass_flow_rate`` [kg/s] where a mass is known, else
        ``discharged_fraction_rate`` or ``particle_flow_rate`` [1/s].

    Raises
    ------
    BadInput
        If the mass is not positive, or the series is too short, not in order, or begins empty.
    NothingToMeasure
        If most of the filling is left at the end, or the last particle leaves before the opening.

    Notes
    -----
    The flow rate is the slope of a line fitted between 20 and 80 % of what leaves.

    Examples
    --------
    >>> import numpy as np
    >>> from rigtwin.lab.records import Series
    >>> time = np.arange(0, 3, 0.01)
    >>> left = Series(time, np.clip(1 - (time - 0.5) / 2, 0, 1), "mass_left", "kg")
    >>> found = {one.quantity: round(one.value, 2) for one in evaluate(left, opened=0.5).quantities}
    >>> found["discharge_time"], found["mass_flow_rate"]
    (2.0, 0.5)
    """
    positive(total_mass=total_mass)
    start = None if opened is None else Instant(opened, {}, "given")
    return evaluate_discharge(left, total_mass, start, None, None, 0.0)


# ------------------------------------------------------------------------------------------------- record -> quantities


def evaluate_discharge(
    left: Series,
    total_mass: float | None,
    opened: Instant | None,
    last: Instant | None,
    residue: float | None,
    area_uncertainty: float,
) -> Evaluation:
    time, share, full = _share_left(left)
    warnings = []
    if opened is None:
        opened = _first_loss(time, share)
        warnings.append("opening: not known, so the first loss was taken as the opening; give the time of opening.")
    if last is None:
        last = _last_loss(time, share)
    if not last.time > opened.time:
        raise NothingToMeasure(
            f"{_named(left)}: the last particle leaves at {last.time:.4g} s, "
            f"before the opening at {opened.time:.4g} s; check the time of opening, or move --start and --end to one "
            "discharge."
        )
    stays = float(share[-1]) if residue is None else residue
    cut = last.method == CUT or _still_flows(time, share, last.time - opened.time)
    if cut and not last.doubtful:
        last = replace(last, doubtful=CUT_SHORT)
    quantities = [
        _instant("opening_time", opened),
        _instant("last_particle_time", last),
        _discharge(opened, last),
    ]
    rates = _rates(time, share, full, left.unit, total_mass, area_uncertainty)
    quantities += rates
    if len(rates) == 1:
        warnings.append(
            "flow rate: not given, because too few values lie in the steady flow; give more values per second."
        )
    elif rates[1].quantity != "mass_flow_rate":
        warnings.append(f"mass flow rate: not given, only a {rates[1].quantity.replace('_', ' ')}; give --total-mass.")
    share_uncertainty = UNKNOWN_SHARE if cut else max(area_uncertainty * stays, 0.003 if area_uncertainty else 0.0)
    remains = Quantity("residue_fraction", stays, share_uncertainty, "1", CUT, doubtful=CUT_SHORT if cut else "")
    quantities.append(remains)
    within = _within_check(rates[0], last.time - opened.time)
    falling = _falling_check(time, share)
    checks = [_emptied_check(stays, cut), within, falling]
    reasons = (opened.doubtful, last.doubtful, "" if within.passed else within.message)
    reason = "; ".join(dict.fromkeys(text for text in reasons if text))
    if reason:
        quantities = [replace(one, doubtful=reason) if one.unit == "s" else one for one in quantities]
    marked = with_times_doubted(tuple(quantities), failed_message(falling))
    return Evaluation(marked, tuple(checks), tuple(warnings))


def _first_loss(time: Array, share: Array) -> Instant:
    """The first loss as the opening; where values flicker, it lies before `FIRST_LOSS` of the filling has left."""
    noise = _noise(share)
    step = {"time step": WITHIN * _step(time)}

    def below(level: float) -> float:
        full = np.flatnonzero(share >= level)
        return float(time[min(int(full[-1]) + 1, len(time) - 1)]) if len(full) else float(time[0])

    earliest = below(1 - 1e-9 - 3 * noise)
    if np.all(np.diff(share) <= 0):  # counted, or weighed without noise
        return Instant(earliest, step, "first loss")
    latest = max(below(1 - FIRST_LOSS), earliest)
    return Instant((earliest + latest) / 2, step | {"first loss": UNKNOWN_SHARE * (latest - earliest)}, "first loss")


def _still_flows(time: Array, share: Array, lasted: float) -> bool:
    """Whether the record ends while particles are still leaving."""
    if share[-1] <= 1e-9 + 3 * _noise(share):
        return False
    end = float(np.median(share[-3:]))
    losing = np.flatnonzero(share > end + max(4 * _noise(share), 1e-9))
    return bool(len(losing) and time[-1] - time[losing[-1]] < max(TAIL * lasted, 3 * _step(time)))


def _emptied_check(stays: float, cut: bool) -> Check:
    message = f"{100 * stays:.1f} % of the filling stays in the hopper"
    if cut:
        message = f"the share that stays in the hopper is not known: {CUT_SHORT}."
    elif stays < RESIDUE:
        message += "."
    else:
        message += "; the last particle is the last one that left."
    return Check("emptied", stays < RESIDUE and not cut, stays, 0.0, message)


def _falling_check(time: Array, share: Array) -> Check:
    """Check that beads only leave."""
    from scipy.ndimage import median_filter

    lasting = np.asarray(median_filter(share, LASTING, mode="nearest"))
    risen = lasting - np.minimum.accumulate(lasting)
    worst = int(np.argmax(risen))
    rise = float(risen[worst])
    if rise < REFILL:
        return Check("only_falls", True, rise, 0.0, "what is left in the hopper only falls.")
    message = (
        f"what is left in the hopper rises by {100 * rise:.0f} % of the filling until {time[worst]:.3f} s, but beads "
        "do not return: the record is joined, or the hopper was filled again; give one discharge (--start, --end)."
    )
    return Check("only_falls", False, rise, 0.0, message)


def _within_check(middle: Quantity, lasted: float) -> Check:
    """Check that most of the flow lies between the opening and the last particle."""
    passed = middle.value < lasted + 2 * middle.std_uncertainty
    message = (
        f"the middle 90 % leaves in {middle.value:.3f} s of the {lasted:.3f} s from the opening to the last particle"
    )
    ending = "." if passed else ", which cannot be: is this a hopper, filmed from before its opening until it is empty?"
    return Check("flow_within", passed, middle.value / lasted if lasted > 0 else math.inf, 0.9, message + ending)


def _share_left(left: Series) -> tuple[Array, Array, float]:
    """Time [s], share left and full value."""
    time, value = np.asarray(left.time, dtype=np.float64), np.asarray(left.value, dtype=np.float64)
    if time.shape != value.shape or len(time) < 5:
        raise BadInput(
            f"{_named(left)}: needs at least five times, each with one value; got {len(time)}, {len(value)}."
        )
    if not np.all(np.isfinite(time)) or not np.all(np.diff(time) > 0):
        raise BadInput(f"{_named(left)}: time does not increase from value to value; sort the series.")
    seen = np.isfinite(value)
    if seen.sum() < 5:
        raise BadInput(f"{_named(left)}: contains fewer than five finite values.")
    value = np.interp(time, time[seen], value[seen])
    full = float(np.median(value[: max(3, len(value) // 50)]))
    if not full > 0:
        raise BadInput(f"{_named(left)}: begins at {full:g}; give what is left from before the opening.")
    if float(value[-1]) > STAYS * full:
        percent = 100 * float(value[-1]) / full
        tail = value[-max(5, len(value) // 10) :]
        stopped = float(np.ptp(tail)) <= max(1e-9, 6 * _noise(value))
        advice = (
            "do not change any more; if beads arch over the outlet use a wider one, and give a record of its opening"
            if stopped
            else "still change; give a record that lasts until the flow has stopped"
        )
        raise NothingToMeasure(
            f"{_named(left)}: {percent:.0f} % is still left at the end, at most {100 * STAYS:.0f} % may be, and the "
            f"last {len(tail)} values, from {time[-len(tail)]:.4g} s on, {advice}."
        )
    return time, value / full, full


def _named(left: Series) -> str:
    return left.quantity.replace("_", " ")


def _noise(share: Array) -> float:
    """Standard deviation of single values, from their second differences; 0 for a counted record."""
    bends = np.diff(share, 2)
    quiet = bends[-max(len(bends) // 5, 3) :]
    return mad_std(quiet, centre=0.0) / math.sqrt(6)


def _step(time: Array) -> float:
    return float(np.median(np.diff(time)))


def _last_loss(time: Array, share: Array) -> Instant:
    end = float(np.median(share[-max(3, len(share) // 50) :]))
    above = np.flatnonzero(share > end + max(3 * _noise(share), 1e-9))
    if len(above) == 0:
        raise NothingToMeasure(
            f"hopper: what is left never lies above its last value by more than its noise ({time[0]:.4g} to "
            f"{time[-1]:.4g} s); give a record from before the opening until the flow has stopped."
        )
    k = min(int(above[-1]), len(time) - 2)
    # a counted record loses its last particle at an unknown time between these two values
    middle, step = (time[k] + time[k + 1]) / 2, time[k + 1] - time[k]
    return Instant(float(middle), {"time step": WITHIN * float(step)}, "last loss")


def _instant(name: str, found: Instant) -> Quantity:
    return Quantity(
        name, found.time, root_sum_of_squares(found.budget), "s", found.method, 1, {}, found.budget, found.doubtful
    )


def _discharge(opened: Instant, last: Instant) -> Quantity:
    # the position of the exposure within the frame interval shifts both ends alike
    shared = ("exposure",)
    budget = {f"opening: {part}": value for part, value in opened.budget.items() if part not in shared}
    budget |= {f"last particle: {part}": value for part, value in last.budget.items() if part not in shared}
    return Quantity(
        "discharge_time",
        last.time - opened.time,
        root_sum_of_squares(budget),
        "s",
        f"{opened.method} to {last.method}",
        1,
        {},
        budget,
    )


def _rates(
    time: Array, share: Array, full: float, unit: str, total_mass: float | None, area_uncertainty: float
) -> list[Quantity]:
    """Steady flow rate, and the time from 5 to 95 %, which does not depend on stragglers."""
    gone = 1 - np.minimum.accumulate(share)
    final = float(gone[-1])

    def when(part: float) -> float:
        k = int(np.argmax(gone >= part * final))
        if k == 0:
            return float(time[0])
        return float(np.interp(part * final, gone[k - 1 : k + 1], time[k - 1 : k + 1]))

    start, end = when(STEADY[0]), when(STEADY[1])
    step = _step(time)
    quantities = [
        Quantity(
            "discharge_time_5_95",
            when(0.95) - when(0.05),
            math.hypot(step / 4, math.sqrt(2) * AT_ENDS * area_uncertainty / (STEADY[1] - STEADY[0]) * (end - start)),
            "s",
            "5 to 95 % of what leaves",
        )
    ]
    part = (time >= start) & (time <= end)
    if part.sum() < 4:
        return quantities
    slope = -float(np.polyfit(time[part], share[part], 1)[0])
    edges = np.linspace(start, end, BINS + 1)
    pieces = -np.diff(np.interp(edges, time, share)) / np.diff(edges)
    drift = float(pieces[BINS // 2 :].mean() - pieces[: BINS // 2].mean())
    budget = {
        "scatter of the flow": slope * float(np.std(pieces, ddof=1) / slope) / math.sqrt(BINS),
        "area for mass": area_uncertainty * slope,
    }
    detail: dict[str, Detail] = {"from_s": round(start, 5), "to_s": round(end, 5), "drift": round(drift / slope, 4)}
    method = f"line, {STEADY[0]:.0%} to {STEADY[1]:.0%}".replace("%", " %")
    if total_mass is not None or unit == "kg":
        name, factor, of = "mass_flow_rate", total_mass if total_mass is not None else full, "kg/s"
    elif full <= 1.5:
        name, factor, of = "discharged_fraction_rate", full, "1/s"
    else:
        name, factor, of = "particle_flow_rate", full, "1/s"
    budget = {key: value * factor for key, value in budget.items() if value > 0}
    quantities.append(Quantity(name, slope * factor, root_sum_of_squares(budget), of, method, 1, detail, budget))
    return quantities


def failed_message(check: Check | str) -> str:
    """Message of a failed check; empty if it passed or could not be made."""
    return check.message if isinstance(check, Check) and not check.passed else ""


def with_times_doubted(quantities: tuple[Quantity, ...], why: str) -> tuple[Quantity, ...]:
    """Mark quantities in seconds or per second as doubtful: they depend on the clip's clock and on the visible slot."""
    return tuple(doubted(one, why) if "s" in one.unit.split("/") else one for one in quantities)
