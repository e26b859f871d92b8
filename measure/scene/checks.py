"""Checks common to all clips: static camera, bead in view."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from rigtwin.lab.quantity import Check

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rigtwin.measure.scene.pose import Pose

MOST_SHAKE = 3.0  # [px], standard deviation; a larger camera shake is no pure shift of the picture
STILL = 0.1  # [px], standard deviation; a smaller shake counts as none
MOST_LOST = 0.1  # share of the frames that may fail to register (a hand passes, a lamp is switched on)
UNSEEN = "camera motion could not be checked: no fixed object with clear edges was found in the picture"
ADVICE = "keep a fixed, sharp object in view, e.g. the rig's stand"
LEAST_SEEN = 0.7  # share of the frames of its path in which the bead must be measured


def camera_by_scene(poses: Sequence[Pose]) -> Check | str:
    """Check `static_camera` from the background alone, or a note that the picture has too few edges for it."""
    from rigtwin.measure.scene.pose import LOST

    if all(pose == LOST for pose in poses):
        return f"{UNSEEN}; {ADVICE}."
    return static_camera(poses)


def static_camera(poses: Sequence[Pose], most: float = MOST_SHAKE, *, vouched: str = "", reason: str = "") -> Check:
    """Check that the camera stood still or that its shake was measured; fails if neither could be determined.

    `vouched` is other evidence of a static camera, used if no frame registers to the background. `reason` is evidence
    against it. Both are parts of the message.
    """
    from rigtwin.measure.scene.pose import shakes_of

    placed = [pose for pose in poses if pose.placed]
    lost = 1 - len(placed) / max(len(poses), 1)
    if not placed:
        message = f"{UNSEEN}; {vouched or ADVICE}{reason}."
        return Check("static_camera", bool(vouched) and not reason, math.nan, 0.0, message)
    shake = float(np.max(np.std(shakes_of(placed), axis=0)))
    ending = ("" if shake < STILL else "; it was measured and removed") + reason
    if lost > MOST_LOST:
        ending += (
            f"; {100 * lost:.0f} % of the frames could not be registered to the background, their shift is unknown"
        )
    ending += "." if shake < most else ". Use a tripod: so large a shake also rotates and tilts the view."
    return Check(
        "static_camera",
        shake < most and lost <= MOST_LOST and not reason,
        shake,
        0.0,
        f"camera shake: {shake:.2f} px (standard deviation){ending}",
    )


def bead_in_view(share: float, frames: int, what: str) -> Check:
    """Check that the bead was measured in most of the frames of `what`."""
    return Check(
        "bead_in_view",
        share > LEAST_SEEN,
        share,
        1.0,
        f"the bead was measured in {100 * share:.0f} % of the {frames} frames of {what}"
        + ("." if share > LEAST_SEEN else ": it is occluded in the others, which are filled by the fit."),
    )
