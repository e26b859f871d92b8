"""Times of the frames of a record at a constant frame rate."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from rigtwin.lab.errors import BadInput

MOST_FRAMES = 200_000  # 14 minutes at 240 Hz; more is likely an error of the unit, and its evaluation takes minutes


def frame_times(duration: float, frame_rate: float) -> npt.NDArray[np.float64]:
    """Return the times of the frames of a record.

    Parameters
    ----------
    duration : float
        Length of the record [s].
    frame_rate : float
        Frames per second [1/s].

    Returns
    -------
    ndarray, shape (n,)
        Times [s] from 0, at least two.

    Raises
    ------
    BadInput
        If there are more than `MOST_FRAMES`.

    Examples
    --------
    >>> frame_times(0.02, 100.0)
    array([0.  , 0.01, 0.02])
    """
    frames = duration * frame_rate
    if frames > MOST_FRAMES:
        raise BadInput(
            f"{duration:g} s at {frame_rate:g} Hz are {frames:.2g} frames, more than {MOST_FRAMES:,}; "
            "give a shorter duration or a lower frame rate."
        )
    return np.asarray(np.arange(max(2, math.floor(frames + 1e-9) + 1)) / frame_rate)
