"""The sample drops, whose truth is known: a blurred image that changes its size is no motion towards the camera."""

import json
from pathlib import Path

import pytest

import rigtwin

MEDIA = Path(__file__).parents[3] / "sample_media"
TRUTH = json.loads((MEDIA / "truth.json").read_text())["drop"]


@pytest.mark.parametrize("name", ["r01", "r03"])
def test_heights_and_restitution_of_a_sample_drop_are_right_within_their_uncertainty(name):
    true = TRUTH[name]
    found = rigtwin.measure("drop", MEDIA / true["file"], frame_rate="240 Hz", bead_diameter="6.2 mm")
    fall = found.quantity("drop_height")
    bounce = found.quantity("restitution_wall", method="height", bounce=1)
    for one, right in ((fall, true["heights_m"][0]), (bounce, true["restitution_from_heights"][0])):
        assert one.value == pytest.approx(right, abs=3 * one.std_uncertainty)
    assert bounce.value == pytest.approx(true["restitution_from_heights"][0], abs=0.001)
    assert "line_of_sight" not in {check.check for check in found.checks}
