"""A hopper with a slot that a slide opens: discharge time, mass flow, and what stays behind.

`measure` turns a clip into what is left in the hopper over time, `evaluate` that into quantities; a simulated hopper
goes through the same `evaluate`.  The slot opens when the slide's trailing edge passes its near edge; the last particle
is out when its centre is one radius below the slot, which is when its upper edge passes the slot.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from rigtwin.lab.camera import Camera
from rigtwin.lab.content import sha256
from rigtwin.lab.errors import BadInput, NothingToMeasure
from rigtwin.lab.progress import Progress, silent
from rigtwin.lab.quantity import Check, Detail, Evaluation, Measurement, Quantity, doubted, failed, root_sum_of_squares
from rigtwin.lab.records import Series
from rigtwin.measure.bead_size import size_seen, size_unseen
from rigtwin.measure.frame_steps import timing_check
from rigtwin.measure.freefall import fall_below, fall_check, outlet_check, together
from rigtwin.measure.gate import Opening, find_opening, slot_edges
from rigtwin.measure.in_view import STILL, camera_by_scene
from rigtwin.measure.media import Video, open_video
from rigtwin.measure.outflow import REACH_BELOW, Outflow, bin_walls, follow_outflow
from rigtwin.measure.repeats import at_its_pace
from rigtwin.measure.spacing import NEIGHBOURS_DOUBT, bead_spacing, size_of_beads
from rigtwin.measure.starved import compression_check
from rigtwin.measure.stated_roll import nothing_level, upright_checks
from rigtwin.measure.upright import Upright

Array = npt.NDArray[np.float64]

STEADY = (0.2, 0.8)  # of what leaves, the part over which the flow is steady
EXPOSURE = 0.15  # frames, standard deviation of where in its frame's interval an unknown exposure lies
# of the time between two values, in which an instant lies anywhere: 1.96 of it make 95 % of that time.  Its standard
# deviation, 1 / sqrt 12 of it, would make intervals that hold the truth always
WITHIN = 0.95 / (2 * 1.96)
CROSSING = 0.2  # frames, of the last particle's passage read between two frames
GIVEN_DOUBT = 0.01  # relative, of a scale read off a length in view
BIN_DOUBT = 0.04  # relative, of a scale from the bin's walls, whose depth in view is not known
BEAD_DOUBT = 0.15  # likewise from beads in a crowded bed, whose rims hide each other
CUT = "end of the record"
CUT_SHORT = (
    "beads still leave at the end of the record, so that the discharge lasts longer than told (a lower bound) and the "
    "empty hopper is not seen; a longer record shows it"
)
UNKNOWN_SHARE = 1 / math.sqrt(12)  # standard deviation of a share of which nothing is known
TAIL = 0.02  # of the discharge, without a loss at the record's end, from which on the flow has stopped
LASTING = 5  # values by most of which what was there is told: something may pass in one
REFILL = 0.1  # share of the filling, by which it must: light and codec change the bed's area by some hundredths
BINS = 6  # parts of the steady flow whose rates are compared
HIDDEN = 0.08  # share of the slot's width that may show no bead before something hides it
# of the rows in which a column lies between beads of the full bed, that show none where something is in front
PARTED = 0.8
DEEP = 2.0  # bead diameters of such rows: the bed's upper border is uneven by less
COVERED = 0.5  # of the filling, that may leave behind what is in front of the bed: else more is drawn through than seen
CLOSED = 4.0  # frames before the opening that show the slot closed: a slide takes two or three to leave it
EARLY, LATE = 0.95, 0.2  # of the bed, between which it goes about as fast from frame to frame
STAYS = 0.7  # of the bed, above which no discharge is seen
RESIDUE = 0.02  # share of the bed that may stay behind before it is worth a warning
# checks without which the times of what leaves are doubtful
UNSEEN = ("slot_in_view", "bed_uncovered", "bed_clear", "static_camera")
# [deg], by which a roll may be wrong: the ends of a slot six beads wide then lie 0.16 of a bead off, about as far as is
# not known of its row
SLIGHT_ROLL = 3.0
# of the slot's width, by which its edge is off in a picture turned wrong by that much: a level row leaves the gap
# between bed and slide before the slot ends, in drawn films by a sixth of the slot at most
EDGE_ASLANT = 0.1
NEARBY = 4  # frames about an instant in which something in front of the hopper makes it doubtful
# bits per pixel of the bed, on which the codec spends them, below which it leaves what is faint as it was for a frame
# or so until it moved on: ends of 22 films of 0.09 to 0.18 were off by 0.6 frames (rms), 1.7 at most; those of 0.37 and
# more by no more than an original's, and pouring beads have 0.6
STARVED = 0.25
USUAL_SHARE = 0.235  # of the picture, that the beds of these films cover
BLIND = 0.085  # fewer than any of these had: nothing tells how long things stand then
# times the noise, by which the bed must differ from the empty hopper: a bead's shaded half differs by half as much, and
# that has to be clear by one of the three that noise hardly reaches
BED_CLEAR = 8.0
FAINTEST = 12.5  # [grey levels], likewise in a film without noise: by a step of a codec's quantiser at usual strength
AREA_DOUBT = 0.05  # relative, how far the bed's visible area follows its mass
AT_ENDS = 0.25  # of that, where little has loosened yet, and where little is left


@dataclass(frozen=True)
class Instant:
    """A moment found, with its doubt."""

    time: float  # [s]
    budget: dict[str, float]  # [s]
    method: str
    doubtful: str = ""


def measure(
    clip: Path,
    camera: Camera,
    *,
    bead_diameter: float | None = None,
    total_mass: float | None = None,
    bin_width: float | None = None,
    out: Path | None = None,
    progress: Progress = silent,
) -> Measurement:
    """Opening, last particle, discharge time and flow rate from a clip of a hopper that empties.

    `bead_diameter` [m], `total_mass` [kg] of the filling, `bin_width` [m] inside; pictures go into `out`.  Raises
    `NothingToMeasure` when no bed leaves.
    """
    for name, value in (("bead diameter", bead_diameter), ("total mass", total_mass), ("bin width", bin_width)):
        if value is not None and not (math.isfinite(value) and value > 0):
            raise BadInput(f"hopper: {name} must be positive, got {value:g}.")
    video = at_its_pace(open_video(clip, camera), progress)
    bead = bead_diameter / camera.given_scale if bead_diameter and camera.given_scale else None
    seen = follow_outflow(video, roll=camera.roll, region=camera.region, bead=bead, progress=progress)
    edges = _edges(seen)
    gate = _gate(seen, edges)
    opened = _opened(seen, gate)
    hidden = _hidden(seen, edges)
    last = _last_particle(seen, edges)
    if hidden > HIDDEN:
        last = replace(last, budget=last.budget | {"hidden part of the slot": seen.interval})
    opened, last = (_unhidden(seen, moment) for moment in (_closed_before(seen, opened), last))
    still = camera_by_scene([moment.pose for moment in seen.moments])
    compression, starved = _compression(seen, video, still)
    if starved:
        opened, last = (_starved(seen, moment, _failed(compression)) for moment in (opened, last))
    left = _left(seen)
    evaluation = _evaluate(left, total_mass, opened, last, seen.residue, AREA_DOUBT)
    timing = _timing_check(seen, left.value, opened, last)
    spacing = bead_spacing(seen.scenery.full, seen.scenery.bed)
    scale, scale_from, scale_doubt = _scale(seen, camera, bead_diameter, bin_width, spacing)
    warnings = [*video.warnings, *evaluation.warnings]
    warnings.append("mass left: taken from the bed's visible area, as of a slab of even depth.")
    view: dict[str, Any] = {
        "frame_rate_hz": video.frame_rate,
        "scale_m_per_px": scale,
        "scale_from": scale_from,
        "camera_roll_deg": math.degrees(seen.upright.roll),
        "camera_roll_from": seen.upright.source,
        "slot_width_px": (edges[1] - edges[0]) / seen.lens.zoom,
        "slide_goes": {1: "right", -1: "left", 0: "not told"}[gate.direction if gate is not None else 0],
        "frames": len(seen.moments),
    }
    velocity = _outlet_velocity(seen, scale, scale_doubt, bin_width)
    quantities = evaluation.quantities
    size: Check | str = ""
    rate: Check | str = "frame rate not confirmed: without a scale the beads' fall does not show it."
    if isinstance(velocity, str):
        warnings.append(f"outlet velocity: none given, for {velocity}.")
    if scale is not None:
        size = _size_check(seen, scale, scale_from, scale_doubt, bead_diameter, spacing, bin_width)
        told = None if isinstance(velocity, str) else doubted(velocity, _failed(size))
        width = view["slot_width_px"] * scale
        rate = _rate_check(seen, told, width, video.frame_rate, scale=scale, doubt=scale_doubt, hidden=hidden > HIDDEN)
        quantities = quantities if told is None else (*quantities, told)
    asked = (timing, rate, size, still, nothing_level(seen.upright))
    warnings += [each for each in asked if isinstance(each, str) and each]
    judged = [each for each in asked if isinstance(each, Check)]
    checks = (
        *_checks_of_picture(seen, gate, hidden),
        _bed_check(seen, left.value, opened),
        *upright_checks(seen.upright),
        compression,
        *evaluation.checks,
        *judged,
    )
    for why in (_failed(timing), _failed(rate), video.spoilt, *(_failed(one) for one in checks if _spoils_times(one))):
        quantities = _with_times_doubted(quantities, why)
    if why := video.broken_off:
        quantities = tuple(
            each if why.removesuffix(".") in each.doubtful else doubted(each, why) for each in quantities
        )
    if last.method == CUT:
        quantities = tuple(each if each.doubtful else doubted(each, CUT_SHORT) for each in quantities)
    result = Measurement(
        rig="hopper",
        source=clip,
        source_sha256=sha256(clip),
        quantities=quantities,
        checks=checks,
        warnings=tuple(warnings),
        camera=view,
        series=(left,),
    )
    if out is None:
        return result
    from rigtwin.measure.hopper_pictures import write_pictures

    return replace(result, files=write_pictures(out, result, video, seen, left, edges, scale, progress))


def evaluate(left: Series, *, total_mass: float | None = None, opened: float | None = None) -> Evaluation:
    """Quantities of a discharge from what is left in the hopper over time, filmed or simulated.

    `left` is a fraction, a mass [kg] or a number of particles, falling over time; a particle counts as left until its
    centre is one radius below the outlet.  `total_mass` [kg] of the filling; `opened` [s], without it the first loss
    counts as the opening.  Raises `NothingToMeasure` when nothing leaves.
    """
    if total_mass is not None and not (math.isfinite(total_mass) and total_mass > 0):
        raise BadInput(f"hopper: total mass must be positive, got {total_mass:g}.")
    start = None if opened is None else Instant(opened, {}, "given")
    return _evaluate(left, total_mass, start, None, None, 0.0)


# ------------------------------------------------------------------------------------------------- record -> quantities


def _evaluate(
    left: Series,
    total_mass: float | None,
    opened: Instant | None,
    last: Instant | None,
    residue: float | None,
    area_doubt: float,
) -> Evaluation:
    time, share, full = _share_left(left)
    warnings = []
    if opened is None:
        first = int(np.argmax(share < 1 - 1e-9 - 3 * _noise(share)))
        opened = Instant(float(time[first]), {"time step": WITHIN * _step(time)}, "first loss")
        warnings.append("opening: not known, the first particle's leaving was taken for it; give the time of opening.")
    if last is None:
        last = _last_loss(time, share)
    if not last.time > opened.time:
        raise NothingToMeasure(
            f"{_named(left)}: the last particle leaves at {last.time:.4g} s, "
            f"before the opening at {opened.time:.4g} s; check the time of opening."
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
    rates = _rates(time, share, full, left.unit, total_mass, area_doubt)
    quantities += rates
    if len(rates) == 1:
        warnings.append(
            "flow rate: none given, for too few frames show the steady flow; a higher rate or a longer flow shows more."
        )
    elif rates[1].quantity != "mass_flow_rate":
        warnings.append(f"mass flow rate: none given, but a {rates[1].quantity.replace('_', ' ')}; give --total-mass.")
    share_doubt = UNKNOWN_SHARE if cut else max(area_doubt * stays, 0.003 if area_doubt else 0.0)
    remains = Quantity("residue_fraction", stays, share_doubt, "1", CUT, doubtful=CUT_SHORT if cut else "")
    quantities.append(remains)
    within = _within_check(rates[0], last.time - opened.time)
    falling = _falling_check(time, share)
    checks = [_emptied_check(stays, cut), within, falling]
    doubts = (opened.doubtful, last.doubtful, "" if within.passed else within.message)
    doubt = "; ".join(dict.fromkeys(text for text in doubts if text))
    if doubt:
        quantities = [replace(one, doubtful=doubt) if one.unit == "s" else one for one in quantities]
    told = _with_times_doubted(tuple(quantities), _failed(falling))
    return Evaluation(told, tuple(checks), tuple(warnings))


def _still_flows(time: Array, share: Array, lasted: float) -> bool:
    """Whether a record that does not end empty ends with its last loss: nothing tells that no other follows."""
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
    """Whether beads only leave."""
    from scipy.ndimage import median_filter

    lasting = np.asarray(median_filter(share, LASTING, mode="nearest"))
    risen = lasting - np.minimum.accumulate(lasting)
    worst = int(np.argmax(risen))
    rise = float(risen[worst])
    if rise < REFILL:
        return Check("only_falls", True, rise, 0.0, "what is left in the hopper only falls.")
    message = (
        f"what is left in the hopper rises by {100 * rise:.0f} % of the filling until {time[worst]:.3f} s, but beads "
        "do not come back: the record is joined, or the hopper was filled again; give one discharge (--start, --end)."
    )
    return Check("only_falls", False, rise, 0.0, message)


def _within_check(middle: Quantity, lasted: float) -> Check:
    """Whether what leaves does so between the opening and the last particle."""
    passed = middle.value < lasted + 2 * middle.std_uncertainty
    message = (
        f"the middle 90 % leaves in {middle.value:.3f} s of the {lasted:.3f} s from the opening to the last particle"
    )
    ending = "." if passed else ", which cannot be: is this a hopper, seen from before its opening until it is empty?"
    return Check("flow_within", passed, middle.value / lasted if lasted > 0 else math.inf, 0.9, message + ending)


def _share_left(left: Series) -> tuple[Array, Array, float]:
    """Time, share that is left, and the full value."""
    time, value = np.asarray(left.time, dtype=np.float64), np.asarray(left.value, dtype=np.float64)
    if time.shape != value.shape or len(time) < 5:
        raise BadInput(
            f"{_named(left)}: needs at least five times, each with one value; got {len(time)}, {len(value)}."
        )
    if not np.all(np.isfinite(time)) or not np.all(np.diff(time) > 0):
        raise BadInput(f"{_named(left)}: time does not rise from value to value; sort the series.")
    seen = np.isfinite(value)
    if seen.sum() < 5:
        raise BadInput(f"{_named(left)}: holds fewer than five finite values.")
    value = np.interp(time, time[seen], value[seen])
    full = float(np.median(value[: max(3, len(value) // 50)]))
    if not full > 0:
        raise BadInput(f"{_named(left)}: begins at {full:g}; give what is left from before the opening on.")
    if float(value[-1]) > STAYS * full:
        percent = 100 * float(value[-1]) / full
        tail = value[-max(5, len(value) // 10) :]
        stopped = float(np.ptp(tail)) <= max(1e-9, 6 * _noise(value))
        advice = (
            "nothing leaves any more: beads arch over the outlet, or it was not opened; take a wider outlet"
            if stopped
            else "beads still leave; give a record that goes on until the flow has stopped"
        )
        raise NothingToMeasure(f"{_named(left)}: {percent:.0f} % is still left at the end and {advice}.")
    return time, value / full, full


def _named(left: Series) -> str:
    return left.quantity.replace("_", " ")


def _noise(share: Array) -> float:
    """Standard deviation of single values, from their second differences; 0 for a counted record."""
    bends = np.diff(share, 2)
    quiet = bends[-max(len(bends) // 5, 3) :]
    return float(np.median(np.abs(quiet))) * 1.4826 / math.sqrt(6)


def _step(time: Array) -> float:
    return float(np.median(np.diff(time)))


def _last_loss(time: Array, share: Array) -> Instant:
    end = float(np.median(share[-max(3, len(share) // 50) :]))
    above = np.flatnonzero(share > end + max(3 * _noise(share), 1e-9))
    if len(above) == 0:
        raise NothingToMeasure("hopper: nothing leaves in this record.")
    k = min(int(above[-1]), len(time) - 2)
    # a counted record loses its last particle somewhere between these two values
    middle, step = (time[k] + time[k + 1]) / 2, time[k + 1] - time[k]
    return Instant(float(middle), {"time step": WITHIN * float(step)}, "last loss")


def _instant(name: str, found: Instant) -> Quantity:
    return Quantity(
        name, found.time, root_sum_of_squares(found.budget), "s", found.method, 1, {}, found.budget, found.doubtful
    )


def _discharge(opened: Instant, last: Instant) -> Quantity:
    # an exposure that lies late in its frame's interval moves both ends alike
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
    time: Array, share: Array, full: float, unit: str, total_mass: float | None, area_doubt: float
) -> list[Quantity]:
    """Steady rate of flow, and the time from 5 to 95 %, which no straggler can stretch."""
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
            math.hypot(step / 4, math.sqrt(2) * AT_ENDS * area_doubt / (STEADY[1] - STEADY[0]) * (end - start)),
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
        "area for mass": area_doubt * slope,
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


# ----------------------------------------------------------------------------------------------------- media -> record


def _left(seen: Outflow) -> Series:
    time = np.array([moment.time for moment in seen.moments])
    area = np.array([moment.left for moment in seen.moments])
    clear = ~_covered(seen)
    if clear.any():
        area = np.interp(time, time[clear], area[clear])
    full = float(np.median(area[:5]))
    return Series(time, area / max(full, 1.0), "fraction left in the hopper", "1")


def _covered(seen: Outflow) -> npt.NDArray[np.bool_]:
    """In which frames something is in front of the bed or the slot."""
    return np.array([moment.covered for moment in seen.moments])


def _edges(seen: Outflow) -> tuple[float, float]:
    """Left and right edge of the slot [px], upright."""
    slot = seen.scenery.slot
    return slot_edges(_beads_in_slot(seen), slot.left, slot.right)


def _hidden(seen: Outflow, edges: tuple[float, float]) -> float:
    """Share of the slot that something stands before: beads pass to its sides, or it hides an end of the slot."""
    slot = np.arange(math.ceil(edges[0]), math.floor(edges[1]) + 1)
    if len(slot) == 0:
        return 1.0
    share = _beads_in_slot(seen)[:, slot].mean(axis=0)
    # not the median: what hides half of the slot would set it
    hidden = set(slot[share < 0.3 * np.percentile(share, 80)].tolist())
    hidden |= before_the_slot(seen.scenery.bed, edges, seen.scenery.bead)
    return len(hidden) / len(hidden | set(slot.tolist()))


def before_the_slot(bed: npt.NDArray[np.bool_], edges: tuple[float, float], bead: float) -> set[int]:
    """Columns in which something parts the `bed` over the slot or within a radius of it; `bead` [px] is a diameter."""
    reach = set(range(math.ceil(edges[0] - bead / 2), math.floor(edges[1] + bead / 2) + 1))
    return reach.intersection(_parting(bed, DEEP * bead).tolist())


def _parting(bed: npt.NDArray[np.bool_], deep: float) -> npt.NDArray[np.intp]:
    """Columns that show no beads where those to both sides do, over `deep` [px] of rows and more.

    A bed has no such gaps: something that stands in front of it parts it.
    """
    from_left, from_right = (np.maximum.accumulate(each, axis=1) for each in (bed, bed[:, ::-1]))
    within = from_left & from_right[:, ::-1]
    rows = within.sum(axis=0)
    return np.flatnonzero((rows > deep) & ((within & ~bed).sum(axis=0) > PARTED * rows))


def _bed_check(seen: Outflow, left: Array, opened: Instant) -> Check:
    """Whether the bed is seen as it leaves: what is `left` is else drawn through the frames that do not show it."""
    covered = _covered(seen)
    early = np.array([moment.time < opened.time for moment in seen.moments])
    if covered[early].any() and (~covered[early]).sum() < CLOSED:
        message = (
            "something is in front of bed or slot until the opening that was found: how much there was is not seen, "
            "nor whether it flowed already; keep the view of bed and slot free."
        )
        return Check("bed_uncovered", False, 1.0, 0.0, message)
    lost = np.maximum(-np.diff(left), 0.0)
    share = float(lost[covered[1:] | covered[:-1]].sum() / max(float(lost.sum()), 1e-9))
    message = f"something is in front of bed or slot while {100 * share:.0f} % of the filling leave"
    ending = "." if share <= COVERED else ": when they do is not seen; keep the view of bed and slot free."
    return Check("bed_uncovered", share <= COVERED, share, 0.0, message + ending)


def _closed_before(seen: Outflow, opened: Instant) -> Instant:
    """The opening, doubtful where the clip hardly shows the slot before it: it may have been open already."""
    before = (opened.time - seen.moments[0].time) / seen.interval
    if before >= CLOSED:
        return opened
    why = (
        f"the clip begins {max(before, 0.0):.1f} frames before the opening that was found, and the slot may have been "
        "open already; let it begin 0.1 s before the slide moves"
    )
    return replace(opened, doubtful=opened.doubtful or why)


def _beads_in_slot(seen: Outflow) -> npt.NDArray[np.bool_]:
    """Where in the rows below the slot beads are, shape (frames, width)."""
    full = seen.strips[:5].astype(np.float64).mean(axis=0)
    empty = seen.strips[-5:].astype(np.float64).mean(axis=0)
    level = max(seen.scenery.level, 8.0)
    strips = seen.strips.astype(np.float64)
    beads = (np.abs(strips - empty).mean(axis=2) > 0.6 * level) & (np.abs(strips - full).mean(axis=2) > 0.6 * level)
    return np.asarray(beads & ~seen.masked)


def _gate(seen: Outflow, edges: tuple[float, float]) -> Opening | None:
    area = np.array([moment.left for moment in seen.moments])
    full = float(np.median(area[:5]))
    gone = np.flatnonzero((area < 0.9 * full) & ~_covered(seen))
    return find_opening(seen.strips, *edges, int(gone[0]) if len(gone) else len(area) - 1, seen.masked)


def _opened(seen: Outflow, gate: Opening | None) -> Instant:
    time = np.array([moment.time for moment in seen.moments])
    frames = np.arange(len(time))
    if gate is not None and math.isfinite(gate.frame) and 0 <= gate.frame < len(time):
        step = seen.interval
        budget = {"slide's edge": gate.sigma * step, "exposure": EXPOSURE * step}
        if math.isfinite(gate.speed):
            aslant = EDGE_ASLANT * math.degrees(_misjudged(seen.upright)) / SLIGHT_ROLL
            off = math.hypot(0.1 * seen.scenery.bead, aslant * (seen.scenery.slot.right - seen.scenery.slot.left))
            budget["slot's edge"] = off / gate.speed * step
        return Instant(float(np.interp(gate.frame, frames, time)), budget, gate.method)
    return _opened_by_flow(seen, time)


def _unhidden(seen: Outflow, found: Instant) -> Instant:
    """The same, doubtful where something passes in front of the hopper about that time."""
    near = [each.hidden for each in seen.moments if abs(each.time - found.time) < (NEARBY + 0.5) * seen.interval]
    if found.doubtful or not any(near):
        return found
    budget = found.budget | {"hidden": NEARBY * seen.interval}
    reason = f"something passes in front of the hopper at {found.time:.3f} s; keep hands out of the view"
    return replace(found, budget=budget, doubtful=reason)


def _compression(seen: Outflow, video: Video, still: Check | str) -> tuple[Check, bool]:
    """Whether the codec's bits show the beads' motion, and whether they are so few that it may come a frame late."""
    bed = float(seen.scenery.bed.sum()) / seen.lens.zoom**2 / (video.width * video.height)
    if not (isinstance(still, Check) and still.value > STILL):
        check = compression_check(video, BLIND, bed, few=STARVED)
        return check, check.value < STARVED
    # of a shaking camera all of the picture moves, and the bed has no more of the bits than its share of the picture
    bed = max(bed, USUAL_SHARE)
    check = compression_check(video, BLIND * bed, few=STARVED * bed)
    return check, check.value < STARVED * bed


def _starved(seen: Outflow, found: Instant, reason: str) -> Instant:
    """The same, uncertain by a frame for a codec that left out what was faint, and doubtful where there is a reason."""
    return replace(found, budget=found.budget | {"compression": seen.interval}, doubtful=found.doubtful or reason)


def _misjudged(turned: Upright) -> float:
    """How far a stated roll [rad] is from that which level edges show, where it fails its check; else 0."""
    if turned.seen is None or not failed(upright_checks(turned)):
        return 0.0
    return abs(turned.roll - turned.seen[0])


def _opened_by_flow(seen: Outflow, time: Array) -> Instant:
    """No slide was seen to move: the bed's first motion above the slot, which begins a little after the opening."""
    change = np.array([moment.change for moment in seen.moments])
    usual = change[1:6]
    level = float(np.median(usual)) + 6 * float(np.std(usual)) + 1.0
    moving = np.flatnonzero((change > level) & (np.roll(change, -1) > level) & ~_covered(seen))
    if len(moving) == 0:
        raise NothingToMeasure("hopper: the bed does not begin to move in this clip; begin it before the opening.")
    first = int(moving[0])
    # a twentieth of a bead of free fall is what can be seen
    return Instant(
        float(time[first]) - 0.5 * seen.interval,
        {"first motion": 0.7 * seen.interval + 0.004, "exposure": EXPOSURE * seen.interval},
        "first motion of the beads",
        "the slide was not seen to free the slot, so the opening is taken from the beads' first motion",
    )


def _last_particle(seen: Outflow, edges: tuple[float, float]) -> Instant:
    """When the upper edge of the uppermost bead passes the slot for good."""
    slot, bead = seen.scenery.slot.row, seen.scenery.bead
    # a bed that ends wider than the slot that beads pass through was seen to end elsewhere: walls of a hopper slope
    wider = seen.scenery.slot.right - seen.scenery.slot.left - (edges[1] - edges[0]) - 0.5 * bead
    # of a camera turned by so much more, the last bead passes one or the other end of the slot so much earlier
    turned = math.hypot(seen.upright.sigma, _misjudged(seen.upright))
    aslant = 0.5 * (edges[1] - edges[0]) * math.tan(turned)
    slot_sigma = math.hypot(seen.scenery.slot.sigma, 0.5 * max(wider, 0.0), aslant)
    clear = ~_covered(seen)
    shown = np.flatnonzero(clear) if clear.sum() > len(clear) / 2 else np.arange(len(clear))
    top = np.array([moment.top for moment in seen.moments])[shown]
    time = np.array([moment.time for moment in seen.moments])[shown]
    above = _still_above(top, slot, bead)
    if len(above) == 0 or above[-1] >= len(top) - 2:
        return Instant(
            float(time[-1]),
            {CUT: seen.interval * 5},
            CUT,
            CUT_SHORT,
        )
    k = int(above[-1])
    below, frames = top[k + 1], int(shown[k + 1] - shown[k])
    if frames == 1 and math.isfinite(below) and below - top[k] < 4 * bead:
        part = (slot - top[k]) / (below - top[k])
        speed = below - top[k]
        budget = {"passage": CROSSING * seen.interval}
        budget["slot's height"] = slot_sigma / max(speed, 1.0) * seen.interval
    else:
        part = 0.5
        budget = {"passage": 0.3 * frames * seen.interval}
    doubtful = ""
    pace = seen.outlet.shift[np.isfinite(seen.outlet.shift[:, 1]), 1]
    before = (top[k] - top[k - 1]) / (shown[k] - shown[k - 1]) if k > 0 else 0.0
    # a bead twice as fast as the flow, or as it was itself, is still seen below the slot a frame later, and no further;
    # the upper edge of a faint one may be taken half a bead too high or too low
    way = min(below, slot + REACH_BELOW * bead) - top[k]
    if frames == 1 and len(pace) and 2 * max(float(np.median(pace)), before) + bead < way:
        budget["not seen to pass"] = NEARBY * seen.interval
        doubtful = f"the last bead vanishes at {time[k]:.3f} s and is not seen to pass the slot: give the original film"
    budget["slot's height"] = min(budget.get("slot's height", 0.0), 3 * seen.interval)
    budget["exposure"] = EXPOSURE * seen.interval
    passed = float(time[k] + part * (time[k + 1] - time[k]))
    return Instant(passed, budget, "upper edge of the last bead at the slot", doubtful)


def _still_above(top: Array, slot: float, bead: float) -> npt.NDArray[np.intp]:
    """Frames in which the uppermost bead, in row `top` [px], has not passed the row `slot`; `bead` is its diameter."""
    # beads do not rise: what shows up above all that was there before is left over of a shake, or of the codec
    before = np.array([np.median(top[max(k - LASTING, 0) : max(k, 1)]) for k in range(len(top))])
    return np.flatnonzero((top < slot) & (top > before - bead))


def outlet_profile(seen: Outflow, scale: float) -> tuple[Array, Array]:
    """Place along the slot from its middle [m], and downward velocity of the beads there [m/s]; NaN: not seen."""
    place, shift = seen.outlet.place[:, 0], seen.outlet.shift[:, 1]
    size = scale / seen.lens.zoom
    return (place - (seen.scenery.slot.left + seen.scenery.slot.right) / 2) * size, shift * size / seen.interval


def _outlet_velocity(seen: Outflow, scale: float | None, scale_doubt: float, bin_width: float | None) -> Quantity | str:
    """Mean downward velocity of the beads in the slot, or in words why it is not known."""
    if scale is None:
        return f"no scale is known; {_other_scale(bin_width)}, or --bead-diameter"
    _, velocity = outlet_profile(seen, scale)
    known = velocity[np.isfinite(velocity)]
    if len(known) < 3:
        return f"frames match in only {len(known)} places of the slot; film at a higher rate, with a shorter exposure"
    value = float(known.mean())
    budget = {
        # neighbouring windows overlap by half
        "scatter along the slot": float(known.std(ddof=1)) / math.sqrt(len(known) / 2),
        "scale": scale_doubt * abs(value),
    }
    detail: dict[str, Detail] = {"windows": len(known), "fastest_m_s": round(float(known.max()), 5)}
    method = "cross-correlation at the slot, mean over the steady flow"
    return Quantity("outlet_velocity", value, root_sum_of_squares(budget), "m/s", method, 1, detail, budget)


def _scale(
    seen: Outflow, camera: Camera, bead_diameter: float | None, bin_width: float | None, spacing: float | None
) -> tuple[float | None, str, float]:
    """[m/px] of the clip, where it comes from, and its relative doubt."""
    if camera.given_scale is not None:
        return camera.given_scale, camera.scale_from, camera.scale_doubt(GIVEN_DOUBT)
    walls = bin_walls(seen.scenery) if bin_width is not None else None
    if walls is not None and bin_width is not None:
        return bin_width / (walls[1] - walls[0]) * seen.lens.zoom, "bin width", BIN_DOUBT
    if bead_diameter is not None and spacing is not None:
        return bead_diameter / size_of_beads(spacing) * seen.lens.zoom, "bead diameter", NEIGHBOURS_DOUBT
    if bead_diameter is not None and seen.scenery.bead_seen:
        return float(bead_diameter / seen.scenery.bead * seen.lens.zoom), "bead diameter", BEAD_DOUBT
    return None, "not known", math.inf


def _size_check(
    seen: Outflow,
    scale: float,
    source: str,
    doubt: float,
    bead_diameter: float | None,
    spacing: float | None,
    bin_width: float | None,
) -> Check | str:
    """Whether beads are as large in the picture as the scale makes them, told by how far apart neighbours lie."""
    if bead_diameter is None or spacing is None or source == "bead diameter":
        missing = "give --bead-diameter" if bead_diameter is None else _other_scale(bin_width)
        missing = missing if spacing is not None else "the bed shows no pattern of beads"
        return size_unseen("the scale and the outlet velocity hang", source, missing)
    ratio = size_of_beads(spacing) / seen.lens.zoom * scale / bead_diameter
    return size_seen(ratio, 3 * math.hypot(doubt, NEIGHBOURS_DOUBT), source)


def _other_scale(bin_width: float | None) -> str:
    """What to give for a scale where `bin_width` did not serve for one."""
    if bin_width is None:
        return "give --bin-width or --scale"
    return "the bin's walls are not made out, for all of --bin-width, so give --scale"


def _rate_check(
    seen: Outflow,
    velocity: Quantity | None,
    width: float,
    rate: float,
    *,
    scale: float,
    doubt: float,
    hidden: bool,
) -> Check | str:
    """Whether time in the clip is that of gravity, or in words why that is not known.

    `scale` [m/px] of the clip and its relative doubt; `hidden`: whether something stands before the slot.
    """
    time = np.array([moment.time for moment in seen.moments])
    # the front of a stream ends where beads come apart, the lowest bead where the first has reached the floor
    fronts = np.array([(moment.front, moment.lowest) for moment in seen.moments]).T - seen.scenery.slot.row
    # of the upright cut, whose pixels are smaller or larger than the clip's
    fronts_fall = fall_below(time, fronts / seen.lens.zoom, seen.scenery.bead / seen.lens.zoom)
    if hidden:  # the lowest bead that is seen may be another one from frame to frame, as each goes behind it
        fronts_fall = None
    stream_fall = seen.stream.fall(seen.interval)
    fall = together([fronts_fall, None if stream_fall is None else stream_fall.at(1 / seen.lens.zoom)])
    if fall is not None:
        return fall_check(fall, scale, doubt, rate)
    if velocity is not None:
        wide = outlet_check(velocity.value, width)
        return f"frame rate not confirmed: {wide.message}" if wide.passed else wide
    return "frame rate not confirmed: no bead is seen to fall from the slot, times are as right as --frame-rate."


def _timing_check(seen: Outflow, left: Array, opened: Instant, last: Instant) -> Check | str:
    from scipy.ndimage import binary_dilation

    time = np.array([moment.time for moment in seen.moments])
    # a hand reaches over the bed's edge before it is told, and a little longer
    hidden = binary_dilation([moment.hidden for moment in seen.moments], np.ones(5, dtype=bool))
    flows = (time[1:] > opened.time) & (time[1:] <= last.time) & ~hidden[1:] & ~hidden[:-1]
    told = np.diff(time) / seen.interval
    changes = np.array([moment.change for moment in seen.moments[1:]])
    # at its ends the flow changes from frame to frame; a gap may reach into them
    gone = np.where((left[:-1] > LATE) & (left[1:] < EARLY), -np.diff(left), math.nan)
    return timing_check(told[flows], seen.stream.frames_between()[flows], changes[flows], gone[flows])


def _failed(check: Check | str) -> str:
    """What a check says against the numbers; nothing where it passed or could not be made."""
    return check.message if isinstance(check, Check) and not check.passed else ""


def _spoils_times(check: Check) -> bool:
    """Whether the times of what leaves hang on this check."""
    turned = check.check == "camera_roll" and abs(check.value - check.expected) > SLIGHT_ROLL
    return turned or check.check in UNSEEN


def _with_times_doubted(quantities: tuple[Quantity, ...], why: str) -> tuple[Quantity, ...]:
    """What is counted in seconds hangs on the clip's clock, and on a slot and beads that are seen."""
    return tuple(doubted(one, why) if "s" in one.unit.split("/") else one for one in quantities)


def _seen_to_open(gate: Opening | None) -> str:
    if gate is None:
        return "the slide was not seen to move; the opening is taken from the beads."
    if math.isfinite(gate.speed):
        return f"the slide was seen to free the slot at {gate.speed:.1f} px per frame."
    if gate.direction == 0:
        return "the slide was seen to free the slot between two frames."
    return (
        "the slide was seen to go, but not where its edge was; the first change in the slot was taken for the opening."
    )


def _checks_of_picture(seen: Outflow, gate: Opening | None, hidden: float) -> list[Check]:
    contrast, noise = seen.scenery.contrast, seen.scenery.noise
    clear = contrast / max(BED_CLEAR * noise, FAINTEST)
    speed = gate.speed if gate is not None else math.nan
    return [
        Check(
            "slide_seen",
            gate is not None,
            speed,
            math.nan,
            _seen_to_open(gate),
        ),
        Check(
            "slot_in_view",
            hidden <= HIDDEN,
            hidden,
            0.0,
            f"{100 * hidden:.0f} % of the slot shows no bead while others pass"
            + ("." if hidden <= HIDDEN else ": something stands before it and may hide the last one."),
        ),
        Check(
            "bed_clear",
            clear >= 1,
            clear,
            1.0,
            f"bed and empty hopper differ by {contrast:.0f} grey levels at a noise of {noise:.1f}"
            + ("." if clear >= 1 else ": too little to tell every bead."),
        ),
    ]
