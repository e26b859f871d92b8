"""The published scatter is that of the tables, and docs/verdicts.md states it."""

from pathlib import Path

import numpy as np
import pytest

import rigtwin
from rigtwin.lab.reference import hlosta2020
from rigtwin.lab.reference.repetition_scatter import _fitted, published_scatter

SLOPE = ("aor_exp_deg", "aor_exp_std_deg")


def relative(number, value, std, keep=lambda _: True):
    return np.array([row[std] / row[value] for row in hlosta2020.table(number) if keep(row)])


@pytest.mark.parametrize(
    ("rig", "quantity", "cells"),
    [
        (
            "pile",
            "angle_of_repose_geometric",
            (15, *SLOPE, lambda row: "piling" in row["rig"]),
        ),
        ("drum", "angle_of_repose_graphical", (14, *SLOPE, lambda row: "drum" in row["rig"])),
        ("tilt", "rolling_friction", (10, "mu_r_pw", "mu_r_pw_std")),
        ("packing", "bed_height", (7, "bed_height_exp_mm", "bed_height_exp_std_mm")),
    ],
)
def test_the_scatter_lies_among_the_printed_ones(rig, quantity, cells):
    printed, found = relative(*cells), published_scatter(rig, quantity)
    low, high = np.quantile(printed, [0.1, 0.9])
    assert low < found.relative < high
    assert 1 < found.freedom < 10
    assert str(cells[0]) in found.source


def test_a_height_that_goes_with_the_square_of_the_restitution_scatters_twice_as_much():
    one, two = (published_scatter("drop", name) for name in ("restitution_wall", "rebound_height"))
    assert (two.relative, two.freedom) == (2 * one.relative, one.freedom)


def test_what_is_not_published_has_the_scatter_of_all_quantities_together():
    found = published_scatter("hopper", "residue_fraction")
    assert found.source.endswith("all quantities together")
    assert found.freedom < published_scatter("tilt", "rolling_friction").freedom, "they differ more among each other"


@pytest.mark.parametrize("freedom", [3.0, 8.0])
def test_scale_and_degrees_of_freedom_are_recovered_from_many_cells(freedom, monkeypatch):
    """Sample variances of ten repetitions whose true variances are scaled inverse chi-squared."""
    rng = np.random.default_rng(5)
    true = 0.05**2 * freedom / rng.chisquare(freedom, 4000)
    variances = true * rng.chisquare(9, 4000) / 9
    monkeypatch.setattr("rigtwin.lab.reference.repetition_scatter._variances", lambda cells: list(variances))

    class Cells:
        freedom = 9

    found = _fitted([Cells()], 1.0, "drawn")
    assert found.relative == pytest.approx(0.05, rel=0.03)
    assert found.freedom == pytest.approx(freedom, rel=0.12)


def test_the_page_of_verdicts_states_the_scatter_that_is_used():
    page = (Path(rigtwin.__file__).parent / "docs" / "verdicts.md").read_text(encoding="utf-8")
    rows = [[cell.strip(" `") for cell in line.split("|")[1:-1]] for line in page.splitlines() if line.startswith("| ")]
    rows = [row for row in rows if len(row) == 5 and row[0] != "rig"]
    assert len(rows) > 15
    for rig, quantity, percent, freedom, source in rows:
        found = published_scatter("drop" if rig == "any" else rig, quantity)
        assert (f"{100 * found.relative:.1f}", f"{found.freedom:.1f}") == (percent, freedom)
        assert found.source == f"{hlosta2020.CITATION}, {source}"
