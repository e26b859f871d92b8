"""What every clip must show: the still scene at rest in the picture, and the bead all the way."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from rigtwin.lab.quantity import Check

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rigtwin.measure.scene.pose import Pose

MOST_SHAKE = 3.0  # [px], standard deviation, up to which a shaking camera only shifts its picture
STILL = 0.1  # [px], likewise, up to which it counts as none
MOST_LOST = 0.1  # of the frames, that may not be found in the scene: a hand passes, a lamp goes on
UNSEEN = "not seen whether the camera stood still: nothing in the picture stands out that stays in its place"
ADVICE = "film something fixed and sharp with it, the rig's stand say"
LEAST_SEEN = 0.7  # of the frames of its path, in which a bead must be measured


def camera_by_scene(poses: Sequence[Pose]) -> Check | str:
    """`static_camera` by the scene alone, or in words that a picture without edges cannot tell."""
    from rigtwin.measure.scene.pose import LOST

    if all(pose == LOST for pose in poses):
        return f"{UNSEEN}; {ADVICE}."
    return static_camera(poses)


def static_camera(poses: Sequence[Pose], most: float = MOST_SHAKE, *, vouched: str = "", doubt: str = "") -> Check:
    """Whether the camera stood still, or its shake was followed; what does not show either is not taken for still.

    `vouched` says what else shows it where the scene has nothing to go by, `doubt` what speaks against it.
    """
    from rigtwin.measure.scene.pose import shakes_of

    placed = [pose for pose in poses if pose.placed]
    lost = 1 - len(placed) / max(len(poses), 1)
    if not placed:
        message = f"{UNSEEN}; {vouched or ADVICE}{doubt}."
        return Check("static_camera", bool(vouched) and not doubt, math.nan, 0.0, message)
    shake = float(np.max(np.std(shakes_of(placed), axis=0)))
    ending = ("" if shake < STILL else "; it was followed and taken out") + doubt
    if lost > MOST_LOST:
        ending += f"; in {100 * lost:.0f} % of the frames the scene was not found again, so how they lie is not known"
    ending += "." if shake < most else ". Use a tripod: so large a shake turns and tilts the view as well."
    return Check(
        "static_camera",
        shake < most and lost <= MOST_LOST and not doubt,
        shake,
        0.0,
        f"the scene shakes by {shake:.2f} px (standard deviation){ending}",
    )


def bead_in_view(share: float, frames: int, what: str) -> Check:
    """Whether the bead was seen in most of the frames of `what`."""
    return Check(
        "bead_in_view",
        share > LEAST_SEEN,
        share,
        1.0,
        f"the bead was measured in {100 * share:.0f} % of the {frames} frames of {what}"
        + ("." if share > LEAST_SEEN else ": something hides it; the rest is filled by the fit."),
    )
