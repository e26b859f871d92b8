from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from rigtwin.compare.diagnose.data.tracked_lab import TrackedLab
from rigtwin.lab.errors import BadInput
from rigtwin.lab.records import Track


def noise_of(lab: TrackedLab, tracks: Sequence[Track]) -> float:
    """[m] one standard deviation of a coordinate: stated, refined by the roughness of the tracks themselves.

    Third differences remove any smooth motion; the median stays clear of impacts.  A coordinate that never changes was
    not measured.
    """
    rough = []
    for track in tracks:
        seen = track.position[:, np.ptp(track.position, axis=0) > 0]
        gap = np.diff(track.time)
        even = np.abs(gap - np.median(gap)) < 0.2 * np.median(gap)
        third = np.abs(np.diff(seen, 3, axis=0))
        # an impact is rough in itself
        calm = (third <= 5 * np.median(third, axis=0)).all(axis=1)
        rough.append(third[even[:-2] & even[1:-1] & even[2:] & calm].ravel())
    differences = np.concatenate(rough)
    if not len(differences):
        if lab.camera.noise > 0:
            return lab.camera.noise
        raise BadInput(
            f"{lab.folder}: no four rows of any track are evenly spaced, so that the tracking noise cannot be read off "
            "them; state tracking_noise_m under camera."
        )
    found = float(np.median(differences)) / 0.6745 / math.sqrt(20.0)
    if not math.isfinite(lab.camera.noise) or lab.camera.noise <= 0:
        return max(found, 1e-7)
    # stated values are rounded; far off they are not believed
    return found if 0.5 < found / lab.camera.noise < 2.0 else max(found, lab.camera.noise)
