"""The combination of colours in which a bead is followed."""

import numpy as np

from rigtwin.measure.media.video import Frame
from rigtwin.measure.tracking.colour_channel import LUMA, channel_without_shadows
from rigtwin.measure.tracking.detect import Spot
from rigtwin.measure.tracking.link import SpotPath


def test_a_bead_that_differs_from_its_background_in_no_colour_is_followed_in_luma():
    black = np.zeros((60, 40, 3), np.uint8)
    frames = [Frame(k, k / 240, black[..., 0], lambda: black) for k in range(6)]
    path = SpotPath(tuple(range(6)), tuple(Spot(20.0, 5.0 + 10 * k, 20.0, 5.0, 5.0, 90.0) for k in range(6)))
    assert channel_without_shadows(frames, path) is LUMA
