"""Camera roll from level edges that agree, with an edge that disagrees."""

from __future__ import annotations

import math

import cv2
import numpy as np
import pytest

from rigtwin.measure.geometry.camera_roll import roll_check, upright

SIZE = (560, 480)  # [px], width and height
STAND = np.arange(SIZE[1])[:, None] + np.zeros(SIZE[0]) > 380


def scene(edges: list[tuple[float, float, float, float, int]]) -> np.ndarray:
    """A grey wall with boards 5 px thick: left end, length, height at the left end [px], slope [deg], brightness."""
    picture = np.full(SIZE[::-1], 150, dtype=np.uint8)
    for x, long, y, slope, grey in edges:
        right = (x + long * math.cos(math.radians(slope)), y + long * math.sin(math.radians(slope)))
        corners = np.array([(x, y), right, (right[0], right[1] + 5), (x, y + 5)])
        cv2.fillConvexPoly(picture, np.round(corners * 16).astype(np.int32), grey, cv2.LINE_AA, 4)
    noise = np.random.default_rng(1).normal(0, 1.5, picture.shape)
    return np.asarray(cv2.GaussianBlur(picture, (0, 0), 0.8) + noise, dtype=np.float32)


BOARDS = [(10, 100, y, 1.4, 90) for y in (40, 120, 200, 280)] + [(440, 100, y, 1.4, 90) for y in (60, 160, 260, 320)]


def test_many_agreeing_edges_outweigh_one_long_clear_edge_along_a_pixel_row() -> None:
    found = upright(scene([*BOARDS, (30, 90, 420, 1.4, 90), (240, 150, 440, 0.0, 40)]), stand=STAND)
    off = abs(math.degrees(found.roll) - 1.4)
    assert off < 0.25
    assert off < 2 * math.degrees(found.sigma) < 1.5


def test_edges_that_disagree_increase_the_uncertainty_of_the_roll() -> None:
    agreeing = upright(scene(BOARDS))
    torn = upright(scene([*BOARDS[:5], *((x, long, y, -1.0, grey) for x, long, y, _, grey in BOARDS[5:])]))
    assert math.degrees(agreeing.roll) == pytest.approx(1.4, abs=0.15)
    assert math.degrees(agreeing.sigma) < 0.5
    assert math.degrees(torn.sigma) > 0.6


@pytest.mark.parametrize(("given", "seen", "sign"), [(-1.5, 1.4, True), (-1.5, 0.02, False), (20, 0.02, False)])
def test_a_wrong_sign_is_named_only_where_it_explains_the_difference(given: float, seen: float, sign: bool) -> None:
    check = roll_check(math.radians(given), math.radians(seen), math.radians(0.1), "the base line shows")
    assert not check.passed
    assert ("the sign may be wrong" in check.message) == sign
    assert "spirit level" in check.message
