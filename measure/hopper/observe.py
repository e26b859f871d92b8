"""Observe a discharge: share left over time, opening, and last particle, from what was counted in every frame."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from rigtwin.lab.arrays import Array
from rigtwin.lab.errors import NothingToMeasure
from rigtwin.lab.quantity import failed
from rigtwin.lab.records import Series
from rigtwin.measure.geometry.camera_roll import Upright, upright_checks
from rigtwin.measure.hopper.evaluate import CUT, CUT_SHORT, LASTING, Instant
from rigtwin.measure.hopper.outflow import REACH_BELOW, Outflow
from rigtwin.measure.hopper.slide_opening import Opening, find_opening, slot_edges

EXPOSURE = 0.15  # [frames], standard deviation of the unknown position of an exposure within its frame interval

CROSSING = 0.2  # [frames], standard uncertainty of the last particle's passage interpolated between two frames

CLOSED = 4.0  # [frames], least time before the opening with a closed slot: a slide takes two or three to leave it

# [deg], largest tolerated error of the roll: it shifts the ends of a slot six beads wide by 0.16 bead diameters, about
# the standard uncertainty of the row of the slot
SLIGHT_ROLL = 3.0

# Error of the slot's edge for a roll wrong by `SLIGHT_ROLL`, as a share of the slot's width.  A row that is not
# parallel to the slot leaves the gap between bed and slide before the slot ends, in drawn films by a sixth of the slot
# at most.
EDGE_ASLANT = 0.1

NEARBY = 4  # frames around an instant in which an occlusion makes it doubtful


# ----------------------------------------------------------------------------------------------------- media -> record


def share_left(seen: Outflow) -> Series:
    time = np.array([moment.time for moment in seen.moments])
    area = np.array([moment.left for moment in seen.moments])
    clear = ~covered_frames(seen)
    if clear.any():
        area = np.interp(time, time[clear], area[clear])
    full = float(np.median(area[:5]))
    return Series(time, area / max(full, 1.0), "fraction left in the hopper", "1")


def covered_frames(seen: Outflow) -> npt.NDArray[np.bool_]:
    """Mask of frames in which something is in front of the bed or the slot, shape (frames,)."""
    return np.array([moment.covered for moment in seen.moments])


def edges_of_slot(seen: Outflow) -> tuple[float, float]:
    """Left and right edge of the slot [px] in the upright picture."""
    slot = seen.scenery.slot
    if slot.stated:
        return slot.left, slot.right
    return slot_edges(beads_in_slot(seen), slot.left, slot.right)


def closed_before(seen: Outflow, opened: Instant) -> Instant:
    """The opening, doubtful if the clip begins so shortly before it that the slot may have been open already."""
    before = (opened.time - seen.moments[0].time) / seen.interval
    if before >= CLOSED:
        return opened
    why = (
        f"the clip begins {max(before, 0.0):.1f} frames before the opening that was found, so the slot may have been "
        "open already; begin the clip 0.1 s before the slide moves"
    )
    return replace(opened, doubtful=opened.doubtful or why)


def beads_in_slot(seen: Outflow) -> npt.NDArray[np.bool_]:
    """Mask of beads in the rows below the slot, shape (frames, width)."""
    full = seen.strips[:5].astype(np.float64).mean(axis=0)
    empty = seen.strips[-5:].astype(np.float64).mean(axis=0)
    level = max(seen.scenery.level, 8.0)
    strips = seen.strips.astype(np.float64)
    beads = (np.abs(strips - empty).mean(axis=2) > 0.6 * level) & (np.abs(strips - full).mean(axis=2) > 0.6 * level)
    return np.asarray(beads & ~seen.masked)


def slide_opening(seen: Outflow, edges: tuple[float, float]) -> Opening | None:
    area = np.array([moment.left for moment in seen.moments])
    full = float(np.median(area[:5]))
    gone = np.flatnonzero((area < 0.9 * full) & ~covered_frames(seen))
    return find_opening(seen.strips, *edges, int(gone[0]) if len(gone) else len(area) - 1, seen.masked)


def opening_instant(seen: Outflow, gate: Opening | None) -> Instant:
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


def unhidden(seen: Outflow, found: Instant) -> Instant:
    """The instant, doubtful if something passes in front of the hopper near that time."""
    near = [each.hidden for each in seen.moments if abs(each.time - found.time) < (NEARBY + 0.5) * seen.interval]
    if found.doubtful or not any(near):
        return found
    budget = found.budget | {"hidden": NEARBY * seen.interval}
    reason = f"something passes in front of the hopper at {found.time:.3f} s; keep hands out of the view"
    return replace(found, budget=budget, doubtful=reason)


def with_compression(seen: Outflow, found: Instant, reason: str) -> Instant:
    """The instant with one frame of uncertainty for lossy compression, and doubtful if there is a reason."""
    return replace(found, budget=found.budget | {"compression": seen.interval}, doubtful=found.doubtful or reason)


def _misjudged(turned: Upright) -> float:
    """Difference [rad] of a stated roll from that of level edges in the picture if its check fails; otherwise 0."""
    if turned.seen is None or not failed(upright_checks(turned)):
        return 0.0
    return abs(turned.roll - turned.seen[0])


def _opened_by_flow(seen: Outflow, time: Array) -> Instant:
    """Opening from the first motion of the bed above the slot, a little after the opening; used if no slide is seen."""
    change = np.array([moment.change for moment in seen.moments])
    usual = change[1:6]
    level = float(np.median(usual)) + 6 * float(np.std(usual)) + 1.0
    moving = np.flatnonzero((change > level) & (np.roll(change, -1) > level) & ~covered_frames(seen))
    if len(moving) == 0:
        raise NothingToMeasure(
            f"hopper: in no two frames in a row from {time[0]:.3f} to {time[-1]:.3f} s the bed above the slot changes "
            f"by more than {level:.1f} grey levels; begin the clip before the opening, or move --start and --end to it."
        )
    first = int(moving[0])
    # a displacement of a twentieth of a bead in free fall is visible
    return Instant(
        float(time[first]) - 0.5 * seen.interval,
        {"first motion": 0.7 * seen.interval + 0.004, "exposure": EXPOSURE * seen.interval},
        "first motion of the beads",
        "the slide was not seen to uncover the slot, so the opening is taken from the first motion of the beads",
    )


def last_particle(seen: Outflow, edges: tuple[float, float]) -> Instant:
    """Instant at which the upper edge of the uppermost bead passes the slot for the last time."""
    slot, bead = seen.scenery.slot.row, seen.scenery.bead
    # the bed ends wider than the slot: it was seen to end elsewhere, because the walls of a hopper slope
    wider = seen.scenery.slot.right - seen.scenery.slot.left - (edges[1] - edges[0]) - 0.5 * bead
    # with a roll error the last bead passes one end of the slot earlier
    turned = math.hypot(seen.upright.sigma, _misjudged(seen.upright))
    aslant = 0.5 * (edges[1] - edges[0]) * math.tan(turned)
    slot_sigma = math.hypot(seen.scenery.slot.sigma, 0.5 * max(wider, 0.0), aslant)
    clear = ~covered_frames(seen)
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
    # a bead twice as fast as the flow, or as itself before, would still be seen below the slot one frame later, and not
    # further; the upper edge of a faint bead is uncertain by half a bead
    way = min(below, slot + REACH_BELOW * bead) - top[k]
    if frames == 1 and len(pace) and 2 * max(float(np.median(pace)), before) + bead < way:
        budget["not seen to pass"] = NEARBY * seen.interval
        doubtful = f"the last bead disappears at {time[k]:.3f} s before it passes the slot: give the original film"
    budget["slot's height"] = min(budget.get("slot's height", 0.0), 3 * seen.interval)
    budget["exposure"] = EXPOSURE * seen.interval
    passed = float(time[k] + part * (time[k + 1] - time[k]))
    return Instant(passed, budget, "upper edge of the last bead at the slot", doubtful)


def _still_above(top: Array, slot: float, bead: float) -> npt.NDArray[np.intp]:
    """Frames in which the uppermost bead, at row `top` [px], has not passed row `slot`; `bead` is a diameter [px]."""
    # beads do not rise: a new patch above all earlier ones is an artefact of camera shake or of the codec
    before = np.array([np.median(top[max(k - LASTING, 0) : max(k, 1)]) for k in range(len(top))])
    return np.flatnonzero((top < slot) & (top > before - bead))
