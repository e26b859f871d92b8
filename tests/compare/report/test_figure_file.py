"""A figure is three files: a drawing with text as text, a bitmap, and a table of the numbers drawn."""

import csv
import io
from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pytest
from PIL import Image

from rigtwin.compare.report import figure_file as subject
from rigtwin.compare.report.figure_file import figure_file, figure_files
from rigtwin.compare.report.figures import deviations_figure
from rigtwin.compare.report.page import drawn_figures
from rigtwin.compare.report.plot_style import canvas
from rigtwin.compare.result_files import write_together

SVG = "{http://www.w3.org/2000/svg}"


def line(name="line", label="A line", rows=({"x_mm": 1.0, "y_mm": 2.5},), **more):
    with canvas() as (figure, axes):
        axes.plot([0, 1, 2], [0, 1, 4])
        axes.set(xlabel="x / mm", ylabel="y / mm")
        return figure_file(figure, name, label, list(rows), **more)


def rows_of(text):
    return list(csv.DictReader(io.StringIO(text)))


def test_the_drawing_is_a_file_of_its_own_whose_text_is_text():
    root = ElementTree.fromstring(line().svg.encode())
    words = {one.text for one in root.iter(f"{SVG}text")}
    assert {"x / mm", "y / mm"} <= words
    assert root.attrib["viewBox"]


def test_in_a_page_the_drawing_has_no_style_sheet_and_says_what_it_shows():
    inline = line(label='Height of "A" & B').inline
    assert inline.startswith("<svg ")
    assert "<style" not in inline
    assert 'aria-label="Height of &quot;A&quot; &amp; B"' in inline


def test_the_bitmap_has_three_hundred_points_an_inch(monkeypatch, coarse_bitmaps):
    monkeypatch.setattr(subject, "DPI", coarse_bitmaps)
    with Image.open(io.BytesIO(line().png)) as picture:
        assert picture.size == (round(7.2 * 300), round(3.2 * 300))
        assert picture.info["dpi"] == pytest.approx((300, 300), abs=0.1)


def test_the_same_figure_is_the_same_file():
    assert line() == line()


@pytest.fixture(scope="module")
def whole(comparison):
    return comparison()


@pytest.fixture(scope="module")
def figures(whole):
    return drawn_figures(whole)


def test_each_curve_of_an_overlay_is_in_the_table_with_units_in_its_columns(figures):
    (height,) = figures["fall"]
    rows = rows_of(height.csv)
    assert list(rows[0]) == ["side", "curve", "time_from_the_first_contact_s", "height_above_the_plate_mm"]
    assert list(dict.fromkeys((row["side"], row["curve"]) for row in rows)) == [
        ("measured", "1"), ("measured", "2"), ("measured", "mean of 2"), ("twin", "1"),
    ]  # fmt: skip
    twin = [row for row in rows if row["side"] == "twin"]
    x, y = (np.array([float(row[name]) for row in twin]) for name in list(rows[0])[2:])
    assert y == pytest.approx(40 * np.cos(3 * x) + 2.0, abs=1e-6)


def test_the_figure_of_the_deviations_has_their_intervals(whole, figures):
    (figure,) = figures[""]
    rows = rows_of(figure.csv)
    assert [row["experiment"] for row in rows] == ["fall", "heap"]
    for row, deviation in zip(rows, whole.deviations, strict=True):
        middle, low, high = (float(row[name]) for name in ("deviation_percent", "low_95_percent", "high_95_percent"))
        assert middle == pytest.approx(deviation.percent_deviation, rel=1e-6)
        assert low < middle < high
        for ratio in (1 + low / 100, 1 + high / 100):  # where the two would just agree
            uncertain = np.hypot(deviation.simulated_std_uncertainty, ratio * deviation.measured_std_uncertainty)
            apart = abs(deviation.simulated - ratio * deviation.measured)
            assert apart == pytest.approx(deviation.z_limit * uncertain, rel=1e-5)
        assert row["verdict"] == deviation.verdict


def test_long_names_are_wrapped_and_an_interval_that_leaves_the_axis_has_an_arrow(whole, monkeypatch, coarse_bitmaps):
    monkeypatch.setattr(subject, "DPI", coarse_bitmaps)
    row = whole.deviations[0]
    long = [
        replace(
            row,
            experiment=f"hopper-with-a-long-name-{number}",
            quantity="discharge_time",
            method="trailing edge of the slide to upper edge of the last bead at the slot",
            measured=1.0,
            measured_std_uncertainty=0.0,
            simulated=1.0 + 0.1 * number,
            simulated_std_uncertainty=0.08,
            percent_deviation=10.0 * number,
            percent_deviation_std=8.0,
            coverage_factor=2.0,
        )
        for number in range(5)
    ]
    within, beyond = (deviations_figure(long, widest) for widest in (100.0, 40.0))
    for figure in (within, beyond):
        with Image.open(io.BytesIO(figure.png)) as picture:
            pixels = np.asarray(picture.convert("L"))
        edge = np.concatenate([pixels[0], pixels[-1], pixels[:, 0], pixels[:, -1]])
        assert edge.min() == 255, "nothing is cut at the edge of the picture"
        words = [one.text or "" for one in ElementTree.fromstring(figure.svg.encode()).iter(f"{SVG}text")]
        assert max(map(len, words)) < 50
        assert " ".join(words).count("of the last bead at the slot") == len(long)
    # the axis ends at 43.2 %, the intervals at 16, 26, 36, 46 and 56 %
    assert beyond.svg.count("<use") - within.svg.count("<use") == 2


def test_figures_that_are_not_drawn_again_are_removed_and_those_of_other_pages_stay(tmp_path):
    (tmp_path / "figures").mkdir()
    mine = tmp_path / "figures" / "my-own.svg"
    mine.write_text("<svg/>")
    write_together(tmp_path, figure_files("report", [line("old"), line("kept")]))
    write_together(tmp_path, figure_files("diagnosis", [line("residual")]))
    write_together(tmp_path, figure_files("report", [line("kept"), line("new")]))
    names = sorted(path.name for path in (tmp_path / "figures").iterdir())
    assert names == sorted(
        [f"{name}.{kind}" for name in ("kept", "new", "residual") for kind in ("csv", "png", "svg")]
        + ["report-captions.csv", "diagnosis-captions.csv", "my-own.svg"]
    )


def test_a_damaged_list_of_figures_names_no_other_file(tmp_path):
    precious = tmp_path / "lab.csv"
    precious.write_text("x")
    (tmp_path / "figures").mkdir()
    (tmp_path / "figures" / "report-captions.csv").write_text("figure,caption\n../lab,x\n/etc/passwd,y\n")
    write_together(tmp_path, figure_files("report", [line()]))
    assert precious.exists()


def test_captions_stand_beside_the_figures(tmp_path):
    write_together(tmp_path, figure_files("report", [line("one", caption='Its "caption", with 2 mm')]))
    (row,) = rows_of((tmp_path / "figures" / "report-captions.csv").read_text())
    assert row == {"figure": "one", "caption": 'Its "caption", with 2 mm'}
