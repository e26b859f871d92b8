"""Captions on overlays: the whole text is inside the picture, and all characters are in the font; films of them."""

import subprocess
import sys

import numpy as np
import pytest
from matplotlib.figure import Figure

from rigtwin.measure.drawing import draw_caption, draw_text, save_plot


def inked(picture):
    """Rows and columns that were drawn on."""
    drawn = (picture != 90).any(axis=2)
    return np.flatnonzero(drawn.any(axis=1)), np.flatnonzero(drawn.any(axis=0))


def blank(height, width):
    return np.full((height, width, 3), 90, np.uint8)


@pytest.mark.parametrize("bottom", [False, True])
def test_a_long_caption_is_wrapped_and_stays_inside(bottom):
    line = "angle of repose, graphical (line 15-85 %): left 26.7 ± 0.8°, right 18.1 ± 0.7°, mean 22.4 ± 0.5°"
    wide, narrow = blank(300, 1400), blank(300, 360)
    draw_caption(wide, [line], bottom=bottom)
    draw_caption(narrow, [line, "doubtful: the outline touches the edge of the picture"], bottom=bottom)
    rows, columns = inked(narrow)
    assert columns.max() < 359
    assert rows.min() > 0
    assert rows.max() < 299
    # nothing is lost by wrapping: more ink than the same words on one line
    assert np.sum(narrow != 90) > np.sum(wide != 90)


def test_a_plus_minus_sign_is_one_character():
    signs = [blank(40, 120) for _ in range(3)]
    for picture, text in zip(signs, ("±", "+", "?"), strict=True):
        draw_text(picture, text, (10, 30))
    assert not np.array_equal(signs[0], signs[1])
    assert not np.array_equal(signs[0], signs[2])


def test_text_wider_than_the_picture_or_outside_raises_no_error():
    picture = blank(30, 40)
    draw_text(picture, "a text that is far too long for this picture", (5, 20))
    assert (picture != 90).any()
    untouched = blank(30, 40)
    draw_text(untouched, "here", (float("nan"), 3))
    draw_text(untouched, "", (3, 3))
    assert (untouched == 90).all()


def test_the_text_of_a_plot_is_text(tmp_path):
    figure = Figure()
    figure.add_subplot().set_xlabel("time / s")
    save_plot(tmp_path / "plot.svg", figure)
    assert ">time / s</text>" in (tmp_path / "plot.svg").read_text(encoding="utf-8")


FILM_WITH_LITTLE_MEMORY = """
import resource
import sys
from pathlib import Path
import numpy as np
import psutil
from rigtwin.measure.drawing import OverlayVideo

picture = np.zeros((1000, 1000, 3), np.uint8)
with OverlayVideo(Path(sys.argv[1]), frame_rate=30) as film:
    room = psutil.Process().memory_info().vms + 25 * 2**20
    resource.setrlimit(resource.RLIMIT_AS, (room, room))
    film.write(picture)
"""


@pytest.mark.skipif(sys.platform != "linux", reason="a limit of the address space")
def test_a_film_that_the_encoder_finds_no_memory_for_is_not_written(tmp_path):
    path = tmp_path / "film.mp4"
    words = [sys.executable, "-c", FILM_WITH_LITTLE_MEMORY, str(path)]
    ended = subprocess.run(words, check=False, capture_output=True, text=True)
    assert ended.stderr.splitlines()[-1] == "MemoryError"
    assert not list(tmp_path.iterdir())
