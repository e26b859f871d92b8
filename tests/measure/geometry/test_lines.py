"""Long straight edges, and runs of marked columns, used to find edges, a drum's bed and a heap."""

import math

import cv2
import numpy as np
import pytest

from rigtwin.measure.geometry.lines import fullest_run, long_lines


@pytest.mark.parametrize("blur", [1.0, 4.0])
@pytest.mark.parametrize("slope", [0.0, 0.6, -1.3])
def test_an_edge_out_of_focus_has_its_slope(blur, slope):
    y, x = np.mgrid[:240, :360].astype(np.float32)
    row = 120 + math.tan(math.radians(slope)) * (x - 180)
    picture = 100 - 60 * np.clip(y - row + 0.5, 0, 1)
    # a box in front of one end of the edge
    picture[60:140, :70] = 150
    picture = cv2.GaussianBlur(picture.astype(np.float32), (0, 0), blur)
    lines = long_lines(picture, np.ones(picture.shape, bool), steepest=math.radians(8), shortest=150, most=8)
    assert math.degrees(lines[0].slope) == pytest.approx(slope, abs=0.02)


@pytest.mark.parametrize("step", [1.5, 2.5])
@pytest.mark.parametrize("share", [0.15, 0.25])
def test_an_edge_that_follows_another_one_in_part_has_an_uncertainty_that_covers_it(step, share):
    y, x = np.mgrid[:240, :360].astype(np.float32)
    row = 120 + np.where(x < share * 360, -step, 0.0)  # the foot of a post, then the edge of the plate
    picture = cv2.GaussianBlur(100 - 60 * np.clip(y - row + 0.5, 0, 1), (0, 0), 1.5).astype(np.float32)
    picture += np.random.default_rng(3).normal(0, 1, picture.shape).astype(np.float32)
    lines = long_lines(picture, np.ones(picture.shape, bool), steepest=math.radians(8), shortest=250, most=8)
    assert math.degrees(lines[0].slope) == pytest.approx(0, abs=2.5 * math.degrees(lines[0].sigma))
    plain = picture[:, 150:]
    (whole, *_) = long_lines(plain, np.ones(plain.shape, bool), steepest=math.radians(8), shortest=150, most=8)
    assert whole.sigma < 0.3 * lines[0].sigma


def marked(text: str) -> np.ndarray:
    return np.array([sign == "#" for sign in text])


def test_a_dense_run_is_preferred_to_a_wider_row_of_specks():
    assert fullest_run(marked("#..#..#..#..#....######.."), gap=3) == (17, 22)


def test_a_run_bridges_gaps_up_to_the_limit():
    assert fullest_run(marked("..##..###...#"), gap=3) == (2, 8)
    assert fullest_run(marked("..##..###...#"), gap=4) == (2, 12)


def test_without_marks_there_is_no_run():
    assert fullest_run(marked("...."), gap=1) is None
