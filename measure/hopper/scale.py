"""Scale of a hopper's clip, and the velocity of the beads in the slot."""

from __future__ import annotations

import math

import numpy as np

from rigtwin.lab.arrays import Array
from rigtwin.lab.camera import Camera
from rigtwin.lab.quantity import Detail, Quantity, root_sum_of_squares
from rigtwin.measure.bulk.checks import NEIGHBOURS_UNCERTAINTY, size_of_beads
from rigtwin.measure.hopper.outflow import Outflow, bin_walls

BIN_UNCERTAINTY = 0.04  # relative standard uncertainty of a scale from the bin's walls, whose depth in view is unknown

BEAD_UNCERTAINTY = (
    0.15  # relative standard uncertainty of a scale from beads in a dense bed, whose rims hide each other
)


def outlet_profile(seen: Outflow, scale: float) -> tuple[Array, Array]:
    """Place along the slot from its middle [m] and downward velocity of the beads there [m/s]; NaN if not seen."""
    place, shift = seen.outlet.place[:, 0], seen.outlet.shift[:, 1]
    size = scale / seen.lens.zoom
    return (place - (seen.scenery.slot.left + seen.scenery.slot.right) / 2) * size, shift * size / seen.interval


def outlet_velocity(
    seen: Outflow, scale: float | None, scale_uncertainty: float, bin_width: float | None
) -> Quantity | str:
    """Mean downward velocity of the beads in the slot [m/s], or the reason why it is not known."""
    if scale is None:
        return f"no scale is known; {other_scale(bin_width)}, or --bead-diameter"
    _, velocity = outlet_profile(seen, scale)
    known = velocity[np.isfinite(velocity)]
    if len(known) < 3:
        return f"frames match in only {len(known)} places of the slot; film at a higher rate, with a shorter exposure"
    value = float(known.mean())
    budget = {
        # neighbouring windows overlap by half, so half of them are independent
        "scatter along the slot": float(known.std(ddof=1)) / math.sqrt(len(known) / 2),
        "scale": scale_uncertainty * abs(value),
    }
    detail: dict[str, Detail] = {"windows": len(known), "fastest_m_s": round(float(known.max()), 5)}
    method = "cross-correlation at the slot, mean over the steady flow"
    return Quantity("outlet_velocity", value, root_sum_of_squares(budget), "m/s", method, 1, detail, budget)


def scale_of(
    seen: Outflow, camera: Camera, bead_diameter: float | None, bin_width: float | None, spacing: float | None
) -> tuple[float | None, str, float]:
    """Scale [m/px] of the clip, its source, and its relative standard uncertainty."""
    if camera.given_scale is not None:
        return camera.given_scale, camera.scale_from, camera.scale_uncertainty()
    walls = bin_walls(seen.scenery) if bin_width is not None else None
    if walls is not None and bin_width is not None:
        return bin_width / (walls[1] - walls[0]) * seen.lens.zoom, "bin width", BIN_UNCERTAINTY
    if bead_diameter is not None and spacing is not None:
        return bead_diameter / size_of_beads(spacing) * seen.lens.zoom, "bead diameter", NEIGHBOURS_UNCERTAINTY
    if bead_diameter is not None and seen.scenery.bead_seen:
        return float(bead_diameter / seen.scenery.bead * seen.lens.zoom), "bead diameter", BEAD_UNCERTAINTY
    return None, "not known", math.inf


def other_scale(bin_width: float | None) -> str:
    """Advice for another source of scale where `bin_width` was not usable."""
    if bin_width is None:
        return "give --bin-width or --scale"
    return "the bin's walls were not found in spite of --bin-width, so give --scale"
