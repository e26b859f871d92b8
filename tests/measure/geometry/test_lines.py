"""Runs of marked columns, by which edges, a drum's bed and a heap are found."""

import numpy as np

from rigtwin.measure.geometry.lines import fullest_run


def marked(text: str) -> np.ndarray:
    return np.array([sign == "#" for sign in text])


def test_what_fills_its_columns_goes_before_a_row_of_specks_that_reaches_further():
    assert fullest_run(marked("#..#..#..#..#....######.."), gap=3) == (17, 22)


def test_a_run_goes_across_gaps_as_wide_as_is_allowed_and_no_wider():
    assert fullest_run(marked("..##..###...#"), gap=3) == (2, 8)
    assert fullest_run(marked("..##..###...#"), gap=4) == (2, 12)


def test_nothing_marked_is_no_run():
    assert fullest_run(marked("...."), gap=1) is None
