"""What the page shows of earlier comparisons."""

import json
import os

import pytest

from rigtwin.compare.deviation import deviations
from rigtwin.lab.checksums import sha256
from rigtwin.lab.quantity import Quantity
from rigtwin.review.compared import comparison, figures, result_file, result_files


@pytest.fixture
def lab(tmp_path):
    (tmp_path / "out").mkdir()
    (tmp_path / "lab.toml").write_text("")
    os.utime(tmp_path / "lab.toml", (1, 1))
    return tmp_path


def written(lab):
    measured, simulated = (
        Quantity("restitution_wall", value, 0.01, "1", "height", detail={"bounce": 1}) for value in (0.40, 0.50)
    )
    rows = deviations("drop", "drop", [measured], [simulated], set_from=None)
    (lab / "out/deviations.json").write_text(json.dumps({"deviations": [row.row() for row in rows]}))


def test_measured_and_simulated_stand_side_by_side(lab):
    written(lab)
    found = comparison(lab / "lab.toml")
    assert found["changed_since"] is False
    (row,) = found["rows"]["drop"]
    assert row["title"] == "Restitution on the wall, bounce 1"
    assert (row["measured"], row["simulated"]) == ("0.400 ± 0.010", "0.500 ± 0.010")
    assert row["deviation"].startswith("+25.0")


def test_a_lab_that_was_changed_since_is_said_to_be(lab):
    written(lab)
    os.utime(lab / "lab.toml")
    os.utime(lab / "out/deviations.json", (2, 2))
    assert comparison(lab / "lab.toml")["changed_since"] is True


def test_a_change_that_was_taken_back_is_none(lab):
    written(lab)
    os.utime(lab / "lab.toml")
    os.utime(lab / "out/deviations.json", (2, 2))
    inputs = [{"file": "lab.toml", "sha256": sha256(lab / "lab.toml")}]
    (lab / "out/provenance.json").write_text(json.dumps({"inputs": inputs}))
    assert comparison(lab / "lab.toml")["changed_since"] is False
    (lab / "lab.toml").write_text("# another\n")
    assert comparison(lab / "lab.toml")["changed_since"] is True


@pytest.mark.parametrize("content", ["", "[]", '{"deviations": [{}]}', '{"deviations": 3}', "{"])
def test_files_that_are_not_of_ours_show_nothing(lab, content):
    (lab / "out/deviations.json").write_text(content)
    assert comparison(lab / "lab.toml") == {}


def test_only_results_in_the_folder_itself_are_listed_and_found(lab):
    for name in ("report.html", "deviations.csv", "notes.txt"):
        (lab / "out" / name).write_text("")
    (lab / "secret.html").write_text("")
    (lab / "out/link.html").symlink_to(lab / "secret.html")
    assert result_files(lab) == ["report.html", "deviations.csv"]
    for name in ("link.html", "../secret.html", "notes.txt", "nothing.html"):
        with pytest.raises(LookupError):
            result_file(lab, name)


def test_figures_are_listed_by_the_page_that_they_are_of(lab):
    assert figures(lab) == []
    (lab / "out/figures").mkdir()
    for name in ("sweep-1", "sweep-2", "steps"):
        (lab / f"out/figures/{name}.svg").write_text("<svg/>")
    (lab / "out/figures/sweep-captions.csv").write_text('figure,caption\nsweep-1,"Height, in mm"\nsweep-2,Angle\n')
    (lab / "out/figures/diagnosis-captions.csv").write_text("figure,caption\nsteps,Where\n")
    (lab / "out/figures/calibration-captions.csv").write_text("figure,caption\nlost,Its file is gone\n")
    diagnosis, sweep = figures(lab)
    assert diagnosis["pictures"] == [{"file": "figures/steps.svg", "caption": "Where"}]
    assert [each["caption"] for each in sweep["pictures"]] == ["Height, in mm", "Angle"]
    (lab / "out/figures/sweep-captions.csv").write_text("name\n../../secret\n")
    assert figures(lab) == [diagnosis]
    for where, page in (("out/flow/figures", "sweep"), ("calibration/figures", "calibration")):
        (lab / where).mkdir(parents=True)
        (lab / where / f"{page}.svg").write_text("<svg/>")
        (lab / where / f"{page}-captions.csv").write_text(f"figure,caption\n{page},Its figure\n")
    files = [picture["file"] for page in figures(lab) for picture in page["pictures"]]
    assert files == ["figures/steps.svg", "calibration/figures/calibration.svg", "flow/figures/sweep.svg"]
    assert all(result_file(lab, name).is_file() for name in files)


def test_a_folder_of_results_that_is_a_link_elsewhere_is_not_shown(lab, tmp_path_factory):
    elsewhere = tmp_path_factory.mktemp("elsewhere")
    (elsewhere / "report.html").write_text("")
    (lab / "out").rmdir()
    (lab / "out").symlink_to(elsewhere)
    assert result_files(lab) == []
