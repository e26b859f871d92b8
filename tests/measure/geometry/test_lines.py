"""Runs of marked columns, used to find edges, a drum's bed and a heap."""

import numpy as np

from rigtwin.measure.geometry.lines import fullest_run


def marked(text: str) -> np.ndarray:
    return np.array([sign == "#" for sign in text])


def test_a_dense_run_is_preferred_to_a_wider_row_of_specks():
    assert fullest_run(marked("#..#..#..#..#....######.."), gap=3) == (17, 22)


def test_a_run_bridges_gaps_up_to_the_limit():
    assert fullest_run(marked("..##..###...#"), gap=3) == (2, 8)
    assert fullest_run(marked("..##..###...#"), gap=4) == (2, 12)


def test_without_marks_there_is_no_run():
    assert fullest_run(marked("...."), gap=1) is None
