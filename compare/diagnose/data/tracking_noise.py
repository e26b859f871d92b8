"""Estimate the tracking noise of a lab from the third differences of its tracks."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from rigtwin.compare.diagnose.data.tracked_lab import TrackedLab
from rigtwin.lab.errors import BadInput
from rigtwin.lab.records import Track


def noise_of(lab: TrackedLab, tracks: Sequence[Track]) -> float:
    """Standard deviation [m] of a tracked coordinate, from the stated value and the tracks.

    Third differences remove smooth motion, and the median is insensitive to impacts.  For white noise of standard
    deviation s, third differences have the variance 20 s^2.  Coordinates that never change were not measured and are
    not used.
    """
    rough = []
    for track in tracks:
        seen = track.position[:, np.ptp(track.position, axis=0) > 0]
        gap = np.diff(track.time)
        even = np.abs(gap - np.median(gap)) < 0.2 * np.median(gap)
        third = np.abs(np.diff(seen, 3, axis=0))
        # an impact has large third differences without noise
        calm = (third <= 5 * np.median(third, axis=0)).all(axis=1)
        rough.append(third[even[:-2] & even[1:-1] & even[2:] & calm].ravel())
    differences = np.concatenate(rough)
    if not len(differences):
        if lab.camera.noise > 0:
            return lab.camera.noise
        raise BadInput(
            f"{lab.folder}: no four successive rows of any track are evenly spaced, so the tracking noise cannot be "
            "estimated from the tracks; state tracking_noise_m under camera."
        )
    found = float(np.median(differences)) / 0.6745 / math.sqrt(20.0)
    if not math.isfinite(lab.camera.noise) or lab.camera.noise <= 0:
        return max(found, 1e-7)
    # stated values are rounded: the estimate is used where both agree within a factor of two, else the larger one
    return found if 0.5 < found / lab.camera.noise < 2.0 else max(found, lab.camera.noise)
