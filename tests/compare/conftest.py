"""What the tests of comparisons, sweeps, calibrations and diagnoses share."""

from collections.abc import Iterator

import pytest

from rigtwin.compare.report import figure_file


@pytest.fixture(autouse=True, scope="session")
def coarse_bitmaps() -> Iterator[float]:
    """Bitmaps of figures with few pixels, which take a fifth of the time; yields their usual resolution [1/inch]."""
    usual = figure_file.DPI
    figure_file.DPI = 50
    yield usual
    figure_file.DPI = usual
