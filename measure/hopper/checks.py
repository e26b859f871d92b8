"""Checks of a filmed discharge: occlusion, contrast, compression, stated sizes, frame rate, missing frames."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from rigtwin.lab.arrays import Array
from rigtwin.lab.materials import PACKING
from rigtwin.lab.quantity import Check, Quantity
from rigtwin.measure.bulk.checks import size_unseen, spacing_check
from rigtwin.measure.hopper.evaluate import Instant
from rigtwin.measure.hopper.free_fall_clock import fall_below, fall_check, outlet_check, together
from rigtwin.measure.hopper.lost_frames import timing_check
from rigtwin.measure.hopper.observe import CLOSED, SLIGHT_ROLL, beads_in_slot, covered_frames
from rigtwin.measure.hopper.outflow import Outflow
from rigtwin.measure.hopper.scale import other_scale
from rigtwin.measure.hopper.slide_opening import Opening
from rigtwin.measure.media.compression import compression_check
from rigtwin.measure.media.video import Video
from rigtwin.measure.scene.checks import STILL

HIDDEN = 0.08  # largest share of the slot's width without beads; above it something hides the slot

# Share of a column's rows between beads of the full bed that show none.  Above it something is in front of the bed.
PARTED = 0.8

DEEP = 2.0  # [bead diameters], least number of such rows: the bed's upper border is uneven by less

COVERED = 0.5  # largest share of the filling that may leave unseen; above it more is interpolated than observed

EARLY, LATE = 0.95, 0.2  # shares left between which the loss from frame to frame is about constant

# if one of these checks fails the times of the discharge are doubtful
UNSEEN = ("slot_in_view", "bed_uncovered", "bed_clear", "static_camera")

# Bits per pixel of the bed.  Below this a codec may freeze faint motion for about a frame.  The ends of 22 films of
# 0.09 to 0.18 were wrong by 0.6 frames rms, 1.7 at most; those of 0.37 and more by no more than in an uncompressed
# film. Films of pouring beads have 0.6.
FEW_BITS = 0.25

USUAL_SHARE = 0.235  # share of the picture that the beds of these films cover

BLIND = 0.085  # bits per pixel, fewer than in any of these films: how long motion freezes is then unknown

# Least difference of bed and empty hopper over the noise.  The shaded half of a bead differs by half as much, and that
# must exceed three times the noise, which noise rarely reaches, by one.
BED_CLEAR = 8.0

# Ratios of a stated mass and that of the bed seen which are accepted.  Beds of 4 to 6 beads in depth fill 0.47 to 0.52
# of the visible area times the depth, a ratio of 0.78 to 0.87, deeper ones up to 0.62, of 1.03; a fifth more on each
# side
MASS_RATIO = (0.62, 1.25)

FAINTEST = 12.5  # [grey levels], the same for a film without noise: one quantiser step of a codec at usual strength


def hidden_share(seen: Outflow, edges: tuple[float, float]) -> float:
    """Share of the slot that is hidden, in its middle, where beads pass on both sides, or at its ends."""
    slot = np.arange(math.ceil(edges[0]), math.floor(edges[1]) + 1)
    if len(slot) == 0:
        return 1.0
    share = beads_in_slot(seen)[:, slot].mean(axis=0)
    # a percentile instead of the median: an object that hides half of the slot would set the median
    hidden = set(slot[share < 0.3 * np.percentile(share, 80)].tolist())
    hidden |= before_the_slot(seen.scenery.bed, edges, seen.scenery.bead)
    return len(hidden) / len(hidden | set(slot.tolist()))


def before_the_slot(bed: npt.NDArray[np.bool_], edges: tuple[float, float], bead: float) -> set[int]:
    """Columns in which something splits the `bed` over the slot or within a radius of it; `bead` is a diameter [px]."""
    reach = set(range(math.ceil(edges[0] - bead / 2), math.floor(edges[1] + bead / 2) + 1))
    return reach.intersection(_parting(bed, DEEP * bead).tolist())


def _parting(bed: npt.NDArray[np.bool_], deep: float) -> npt.NDArray[np.intp]:
    """Columns that show no beads over more than `deep` rows [px] where columns on both sides do.

    A bed has no such gaps, so something stands in front of it.
    """
    from_left, from_right = (np.maximum.accumulate(each, axis=1) for each in (bed, bed[:, ::-1]))
    within = from_left & from_right[:, ::-1]
    rows = within.sum(axis=0)
    return np.flatnonzero((rows > deep) & ((within & ~bed).sum(axis=0) > PARTED * rows))


def bed_check(seen: Outflow, left: Array, opened: Instant) -> Check:
    """Check that the bed is visible while it leaves; otherwise what is `left` is interpolated over hidden frames."""
    covered = covered_frames(seen)
    early = np.array([moment.time < opened.time for moment in seen.moments])
    if covered[early].any() and (~covered[early]).sum() < CLOSED:
        message = (
            "something is in front of bed or slot until the opening that was found, so neither the filling nor an "
            "earlier flow is visible; keep the view of bed and slot free."
        )
        return Check("bed_uncovered", False, 1.0, 0.0, message)
    lost = np.maximum(-np.diff(left), 0.0)
    share = float(lost[covered[1:] | covered[:-1]].sum() / max(float(lost.sum()), 1e-9))
    message = f"something is in front of bed or slot while {100 * share:.0f} % of the filling leave"
    ending = "." if share <= COVERED else ", so their times are not visible; keep the view of bed and slot free."
    return Check("bed_uncovered", share <= COVERED, share, 0.0, message + ending)


def compression_effect(seen: Outflow, video: Video, still: Check | str) -> tuple[Check, bool]:
    """Check the bits per pixel of what moves; and whether they are so few that motion may appear a frame late."""
    bed = float(seen.scenery.bed.sum()) / seen.lens.zoom**2 / (video.width * video.height)
    if not (isinstance(still, Check) and still.value > STILL):
        check = compression_check(video, BLIND, bed, few=FEW_BITS)
        return check, check.value < FEW_BITS
    # if the camera shakes all of the picture moves, so the bed gets only its area's share of the bits
    bed = max(bed, USUAL_SHARE)
    check = compression_check(video, BLIND * bed, few=FEW_BITS * bed)
    return check, check.value < FEW_BITS * bed


def size_check(
    seen: Outflow,
    scale: float,
    source: str,
    uncertainty: float,
    bead_diameter: float | None,
    spacing: float | None,
    bin_width: float | None,
) -> Check | str:
    """Check the bead size in the picture, from the spacing of neighbours, against the scale."""
    if bead_diameter is None or spacing is None or source == "bead diameter":
        missing = "give --bead-diameter" if bead_diameter is None else other_scale(bin_width)
        missing = missing if spacing is not None else "the bed shows no pattern of beads"
        return size_unseen("the scale and the outlet velocity depend", source, missing)
    return spacing_check(spacing / seen.lens.zoom * scale, uncertainty, bead_diameter, source)


def mass_check(
    seen: Outflow, scale: float | None, total_mass: float | None, depth: float | None, bead_density: float | None
) -> Check | str:
    """Check the stated mass [kg] against that of the bed seen, a slab of that depth [m]; empty if one is not known."""
    if total_mass is None or depth is None or bead_density is None:
        return ""
    if scale is None:
        return "the stated mass was not checked, as the size of the bed is not known without a scale."
    area = float(seen.scenery.bed.sum()) * (scale / seen.lens.zoom) ** 2
    slab = PACKING * bead_density * area * depth
    passed = MASS_RATIO[0] < total_mass / slab < MASS_RATIO[1]
    message = (
        f"the bed seen, {1e4 * area:.4g} cm^2 over a depth of {1e3 * depth:.4g} mm, holds about {1e3 * slab:.4g} g at "
        f"a packing of {PACKING:g}, and {1e3 * total_mass:.4g} g are stated or follow from the number of beads"
    )
    advice = ": check mass or count, depth, and size and density of the beads; all of the bed must be in view"
    return Check("filling_mass", passed, total_mass, slab, message + ("." if passed else f"{advice}."))


def rate_check(
    seen: Outflow,
    velocity: Quantity | None,
    width: float,
    rate: float,
    *,
    scale: float,
    uncertainty: float,
    hidden: bool,
) -> Check | str:
    """Check the clock of the clip against gravity, or state why this is not possible.

    `scale` [m/px] of the clip with its relative standard `uncertainty`; `hidden`: whether something is in front of the
    slot.
    """
    time = np.array([moment.time for moment in seen.moments])
    # the front of a stream ends where beads separate, the lowest bead where the first one has reached the floor
    fronts = np.array([(moment.front, moment.lowest) for moment in seen.moments]).T - seen.scenery.slot.row
    # convert from the upright cut to pixels of the clip
    fronts_fall = fall_below(time, fronts / seen.lens.zoom, seen.scenery.bead / seen.lens.zoom)
    if hidden:  # the lowest visible bead may change from frame to frame as beads pass behind the object
        fronts_fall = None
    stream_fall = seen.stream.fall(seen.interval)
    fall = together([fronts_fall, None if stream_fall is None else stream_fall.at(1 / seen.lens.zoom)])
    if fall is not None:
        return fall_check(fall, scale, uncertainty, rate)
    if velocity is not None:
        wide = outlet_check(velocity.value, width)
        return f"frame rate not confirmed: {wide.message}" if wide.passed else wide
    return "frame rate not confirmed: no bead was seen to fall from the slot, so times rely on --frame-rate alone."


def flow_timing_check(seen: Outflow, left: Array, opened: Instant, last: Instant) -> Check | str:
    from scipy.ndimage import binary_dilation

    time = np.array([moment.time for moment in seen.moments])
    # a hand reaches over the edge of the bed a little before and after it is detected
    hidden = binary_dilation([moment.hidden for moment in seen.moments], np.ones(5, dtype=bool))
    flows = (time[1:] > opened.time) & (time[1:] <= last.time) & ~hidden[1:] & ~hidden[:-1]
    stamped = np.diff(time) / seen.interval
    changes = np.array([moment.change for moment in seen.moments[1:]])
    # at its ends the flow changes from frame to frame, and a gap in the frames may reach into them
    gone = np.where((left[:-1] > LATE) & (left[1:] < EARLY), -np.diff(left), math.nan)
    return timing_check(stamped[flows], seen.stream.frames_between()[flows], changes[flows], gone[flows])


def spoils_times(check: Check) -> bool:
    """Whether the times of the discharge depend on this check."""
    turned = check.check == "camera_roll" and abs(check.value - check.expected) > SLIGHT_ROLL
    return turned or check.check in UNSEEN


def _seen_to_open(gate: Opening | None) -> str:
    if gate is None:
        return "the slide was not seen to move; the opening is taken from the beads."
    if math.isfinite(gate.speed):
        return f"the slide was seen to uncover the slot at {gate.speed:.1f} px per frame."
    if gate.direction == 0:
        return "the slide was seen to uncover the slot between two frames."
    return (
        "the slide was seen to go, but its edge was not found; the first change in the slot was taken for the opening."
    )


def checks_of_picture(seen: Outflow, gate: Opening | None, hidden: float) -> list[Check]:
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
            + ("." if hidden <= HIDDEN else ": something is in front of it and may hide the last one."),
        ),
        Check(
            "bed_clear",
            clear >= 1,
            clear,
            1.0,
            f"bed and empty hopper differ by {contrast:.0f} grey levels at a noise of {noise:.1f}"
            + ("." if clear >= 1 else ": too little to detect every bead."),
        ),
    ]
