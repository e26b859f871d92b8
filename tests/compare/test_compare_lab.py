"""Comparison of a whole lab: written files, the report, and what is kept when a run fails."""

import csv
import hashlib
import json
import math
import multiprocessing
import re
import shutil
import signal
import time
from dataclasses import replace
from datetime import UTC, datetime
from html.parser import HTMLParser
from pathlib import Path

import cv2
import numpy as np
import pytest

from rigtwin.cli import run
from rigtwin.compare import compare_lab as subject_compare_lab
from rigtwin.compare import comparison as subject
from rigtwin.compare.campaign.store import Store
from rigtwin.compare.compare_lab import compare
from rigtwin.compare.measure_repetitions import measuring
from rigtwin.compare.result_files import document, write_together
from rigtwin.compare.twins.matched import twin_of
from rigtwin.lab.errors import BadInput, BadLabFile
from rigtwin.lab.file.lab_file import read_lab
from rigtwin.lab.quantity import Measurement, Quantity
from rigtwin.lab.records import Series
from rigtwin.lab.rigs import TiltSettings

FILES = (
    "observations.csv", "deviations.csv", "deviations.json", "report.html", "provenance.json", "methods.md",
    "references.bib",
)  # fmt: skip

LAB = """
[lab]
title = "Ash <beads> & steel"

[particles.bead]
material = "wood_ash"
diameter = "12 mm"
density = "760 kg/m^3"

[contacts.bead-bead]
restitution = 0.70

[[experiments]]
id = "pair/1"
rig = "pendulum"
variant = "double"
particle = "bead"
length = "200 mm"
repetitions = ["day1/swing.csv", "day2/swing.csv", "day2/nothing.csv"]
"""


def swing(path: Path, restitution: float, *, angle: float, seed: int, length: float = 0.2, diameter: float = 0.012):
    """Tracks of two beads with 20 µm of noise, from the small print of a pendulum: energy and restitution only."""
    rate, gravity = 240.0, 9.81
    start, step = math.radians(angle), 1e-5
    quarter, theta, speed = [-start] * 5000, -start, 0.0  # held for 50 ms
    while theta < 0:  # bead A swings down
        quarter.append(theta)
        speed -= gravity / length * math.sin(theta) * step
        theta += speed * step
    hit = len(quarter) * step
    after = {"A": speed * (1 - restitution) / 2, "B": speed * (1 + restitution) / 2}
    time = np.arange(int((hit + 0.35) * rate)) / rate
    rng, rows = np.random.default_rng(seed), ["time_s,x_m,y_m,particle"]
    for body, rest in (("A", -diameter / 2), ("B", diameter / 2)):
        angles, theta, speed = list(quarter) if body == "A" else [0.0] * len(quarter), 0.0, after[body]
        while len(angles) * step < time[-1] + 0.01:
            angles.append(theta)
            speed -= gravity / length * math.sin(theta) * step
            theta += speed * step
        seen = np.asarray(angles)[(time / step).astype(int)]
        x = rest + length * np.sin(seen) + rng.normal(0, 2e-5, len(time))
        y = length * (1 - np.cos(seen)) + rng.normal(0, 2e-5, len(time))
        rows += [f"{t:.6f},{a:.7f},{b:.7f},{body}" for t, a, b in zip(time, x, y, strict=True)]
    path.parent.mkdir(exist_ok=True, parents=True)
    path.write_text("\n".join(rows) + "\n")


@pytest.fixture(scope="module")
def lab(tmp_path_factory):
    folder = tmp_path_factory.mktemp("lab")
    (folder / "lab.toml").write_text(LAB)
    swing(folder / "day1/swing.csv", 0.64, angle=40, seed=1)
    swing(folder / "day2/swing.csv", 0.64, angle=42, seed=2)
    still = "\n".join(f"{t / 240:.6f},0.0,0.0,{body}" for body in "AB" for t in range(100))
    (folder / "day2/nothing.csv").write_text("time_s,x_m,y_m,particle\n" + still + "\n")
    return folder


@pytest.fixture(scope="module")
def compared(lab, tmp_path_factory):
    return compare(lab, tmp_path_factory.mktemp("out"), workers=1)


@pytest.fixture(scope="module")
def out(compared):
    return compared.files["report.html"].parent


@pytest.fixture(scope="module")
def page(out):
    return (out / "report.html").read_text(encoding="utf-8")


def rows_of(path):
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def row_of(rows, **wanted):
    return next(row for row in rows if all(row[name] == value for name, value in wanted.items()))


def test_all_files_exist_and_no_partial_file_remains(out):
    assert {path.name for path in out.iterdir() if path.is_file()} == set(FILES)


def test_the_deviation_is_that_of_the_restitution_in_the_lab_file(out):
    row = row_of(rows_of(out / "deviations.csv"), quantity="restitution_pair", method="velocity")
    assert float(row["measured"]) == pytest.approx(0.64, abs=0.004)
    assert float(row["simulated"]) == pytest.approx(0.70, rel=0.005)
    assert float(row["percent_deviation"]) == pytest.approx(100 * 0.06 / 0.64, abs=1.0)
    assert (row["measured_n"], row["simulated_n"], row["experiment"]) == ("2", "1", "pair/1")


def test_the_twin_starts_from_the_measured_mean_where_the_lab_file_does_not_state_it(out):
    row = row_of(rows_of(out / "deviations.csv"), quantity="release_angle")
    assert float(row["simulated"]) == pytest.approx(41, abs=0.2)
    assert row["verdict"] == "set equal"
    assert "measured" in row["note"]


def test_every_repetition_and_the_twin_are_in_the_observations(out):
    rows = [row for row in rows_of(out / "observations.csv") if row["quantity"] == "release_angle"]
    found = [(row["origin"], row["repetition"]) for row in rows]
    assert found == [("measured", "day1/swing.csv"), ("measured", "day2/swing.csv"), ("simulated", "twin, seed 1")]
    assert [float(row["value"]) for row in rows] == pytest.approx([40, 42, 41], abs=0.3)


def test_json_and_csv_have_the_same_values(out):
    table = rows_of(out / "deviations.csv")
    document = json.loads((out / "deviations.json").read_text())
    assert len(table) == len(document["deviations"])
    for row, entry in zip(table, document["deviations"], strict=True):
        for name, cell in row.items():
            if cell == "":
                assert entry[name] in (None, "")
            elif isinstance(entry[name], float):
                assert float(cell) == pytest.approx(entry[name], rel=1e-6)
            else:
                assert cell == str(entry[name])


def test_a_repetition_that_shows_nothing_is_left_out_with_a_warning(compared, page):
    (outcome,) = compared.outcomes
    assert [failure.source.name for failure in outcome.failures] == ["nothing.csv"]
    assert any("nothing.csv was left out" in warning for warning in outcome.warnings)
    assert "nothing.csv was left out" in page


def test_a_warning_about_one_of_several_views_does_not_name_the_first_photo(compared):
    def view(name: str) -> Quantity:
        return Quantity("angle_of_repose_graphical", 28.0, 1.0, "deg", "line", 1, {"view": name}, {}, "")

    (outcome,) = compared.outcomes
    pile = Measurement(
        "pile", Path("front.jpg"), "", (view("front"), view("side")), (), ("side: too dark.", "scale: not known.")
    )
    warnings = replace(outcome, measurements=(pile,), failures=()).warnings
    assert "side: too dark." in warnings
    assert "front.jpg and its other views: scale: not known." in warnings
    others = replace(pile, source=Path("b/front.jpg")), replace(pile, source=Path("c/front.jpg"))
    warnings = replace(outcome, measurements=others, failures=()).warnings
    assert "b/front.jpg and c/front.jpg and their other views: scale: not known." in warnings
    assert warnings.count("side: too dark.") == 1


def test_a_warning_names_a_doubtful_repetition_that_is_excluded_from_the_mean(compared):
    def drop(name: str, doubtful: str = "") -> Measurement:
        found = [
            Quantity("restitution_wall", 0.42, 0.01, "1", method, doubtful=doubtful) for method in ("height", "time")
        ]
        return Measurement("drop", Path(name), "", tuple(found))

    (outcome,) = compared.outcomes
    said = "r2.mp4 is doubtful and excluded from the mean of Restitution on the wall: the plate moved"

    def warnings_of(*measurements):
        return replace(outcome, measurements=measurements).warnings

    assert said in warnings_of(drop("r1.mp4"), drop("r2.mp4", "the plate moved"))
    assert said not in warnings_of(drop("r2.mp4", "the plate moved")), "alone it is in the mean"


@pytest.mark.parametrize(
    ("stated", "by_hand", "warned"),
    [(2.0, 0.0, False), (2.08, 0.0, False), (0.1, 0.0, True), (2.2, 0.0, True), (2.2, 0.2, False), (3.0, 0.2, True)],
)
def test_a_plate_that_rises_at_another_speed_than_stated_gives_a_warning(compared, stated, by_hand, warned):
    """A plate at 2 deg/s after a second of rest; by hand the speed alternates by 20 %."""
    time = np.arange(600) / 100
    speed = np.where(time < 1, 0, 2 * (1 + by_hand * np.sign(np.sin(1.5 * time))))
    angle = np.cumsum(speed) / 100 + np.random.default_rng(1).normal(0, 0.02, len(time))
    film = Measurement("tilt", Path("t.mp4"), "", (), series=(Series(time, np.radians(angle), "plate_angle", "rad"),))
    (outcome,) = compared.outcomes
    tilt = replace(outcome.experiment, rig=TiltSettings("slide", speed=np.radians(stated)))
    warnings = replace(outcome, experiment=tilt, measurements=(film,), failures=()).warnings
    assert any(f"states a speed of {stated:.3g} deg/s" in warning for warning in warnings) == warned


def test_provenance_names_every_input_by_its_content(lab, out):
    record = json.loads((out / "provenance.json").read_text())
    inputs = {entry["file"]: entry["sha256"] for entry in record["inputs"]}
    assert set(inputs) == {"lab.toml", "day1/swing.csv", "day2/swing.csv", "day2/nothing.csv"}
    for name, digest in inputs.items():
        assert digest == hashlib.sha256((lab / name).read_bytes()).hexdigest()
    assert record["seed"] == 1
    assert record["model"]["contacts"]["bead-bead"]["restitution"] == 0.70
    assert {"rigtwin", "python", "numpy", "taichi"} <= set(record["versions"])
    assert record["borrowed"]


class Page(HTMLParser):
    """Everything in a page that could fetch something or run."""

    def __init__(self, text):
        super().__init__()
        self.sources: list[str] = []
        self.scripts = 0
        self.addresses, self.tags, self.ids = [], set(), set()
        self.feed(text)

    def handle_starttag(self, tag, attributes):
        self.tags.add(tag)
        self.scripts += tag == "script"
        assert tag != "script" or not attributes, "a script from elsewhere"
        for name, value in attributes:
            if name in ("src", "srcset"):
                self.sources.append(value)
            if name in ("src", "href", "xlink:href", "data", "srcset", "poster", "action"):
                self.addresses.append(value)
            if name == "id":
                self.ids.add(value)
            assert not name.startswith("on"), f"{tag} runs a script: {name}"


def linked(addresses):
    """Addresses of files; those of the references lead to a publisher, where one clicks on them."""
    return [address for address in addresses if not address.startswith(("#", "data:image/", "https://doi.org/"))]


def test_the_report_opens_offline_and_fetches_nothing(page, out):
    parsed = Page(page)
    for address in linked(parsed.addresses):
        assert (out / address).is_file(), "only files of the same run may be linked to"
    assert all(source.startswith("data:image/") for source in parsed.sources)
    assert parsed.tags.isdisjoint({"link", "iframe", "object", "embed", "base"})
    assert parsed.scripts == 1
    script = page[page.index("<script>") : page.index("</script>")]
    assert not re.search(r"fetch|XMLHttp|import|https?:|WebSocket|sendBeacon|\.src\b|eval", script)
    assert not re.search(r"@import|url\(\s*['\"]?(?!#)", page)
    assert "<svg" in page


def test_every_figure_of_the_page_is_a_drawing_a_bitmap_and_a_table_and_stands_in_the_provenance(out, page):
    figures = json.loads((out / "provenance.json").read_text())["figures"]
    names = [Path(one["files"][0]).stem for one in figures]
    assert names == ["deviations", "pair-1-angle-of-bead-A", "pair-1-angle-of-bead-B"]
    listed = {name for one in figures for name in one["files"]}
    assert listed == {f"figures/{name}.{kind}" for name in names for kind in ("svg", "png", "csv")}
    on_disk = {path.relative_to(out).as_posix() for path in (out / "figures").iterdir()}
    assert on_disk == listed | {"figures/report-captions.csv"}
    assert listed <= set(Page(page).addresses)
    angles = rows_of(out / "figures" / "pair-1-angle-of-bead-B.csv")
    highest = max(float(row["angle_from_the_vertical_deg"]) for row in angles if row["side"] == "twin")
    rebound = row_of(rows_of(out / "deviations.csv"), quantity="rebound_angle", body="B")
    assert highest == pytest.approx(float(rebound["simulated"]), rel=0.01)


def test_the_methods_text_is_that_of_this_run(out, page):
    text = (out / "methods.md").read_text(encoding="utf-8")
    made = json.loads((out / "provenance.json").read_text())
    (twin,) = made["twins"]["pair/1"]
    assert "`pair/1` (pendulum, double): particle bead, a sphere of 12 mm" in text
    assert "760 kg/m³ over its volume" in text
    assert "length 200 mm" in text
    assert "2 repetitions were measured from 2 tables of tracked data" in text
    assert "1 repetition was not measurable and left out (nothing.csv)" in text
    assert f"restitution {twin['contacts']['bead-bead']['restitution']:g}" in text
    start = row_of(rows_of(out / "deviations.csv"), quantity="release_angle")
    assert f"started from the release angle as measured (the mean), {float(start['measured']):.5g}°" in text
    assert "Not stated by the lab" in text, "the wood is that of the paper"
    assert "OpenCV Library" not in text, "tables of tracked data need none"
    for name in ("rigtwin", "python", "taichi", "numpy"):
        assert made["versions"][name] in text
    assert (out / "references.bib").read_text(encoding="utf-8").count("@") == text.count("\n- `")
    assert "started from the release angle as measured" in page


def test_names_from_the_lab_file_cannot_break_the_page(page):
    assert "Ash &lt;beads&gt; &amp; steel" in page
    assert "<beads>" not in page


def test_the_summary_links_to_the_section_of_its_experiment(page):
    parsed = Page(page)
    targets = [address[1:] for address in parsed.addresses if address.startswith("#pair")]
    assert targets
    assert set(targets) <= parsed.ids


def test_overlay_pictures_are_inside_the_report(lab, tmp_path):
    import cv2

    picture = np.random.default_rng(5).integers(0, 255, (1500, 2000, 3), dtype=np.uint8)
    cv2.imwrite(str(tmp_path / "swing-still.png"), picture)
    experiment = read_lab(lab).experiments[0]
    angle = Quantity("release_angle", 40.0, 0.1, "deg", "swing", detail={"body": "A"}, budget={"tracking": 0.1})
    files = {"still": tmp_path / "swing-still.png", "overlay": tmp_path / "pair" / "swing-overlay.mp4"}
    measurement = Measurement(
        "pendulum", Path("swing.mp4"), "0" * 64, (angle,), camera={"frame_rate_hz": 240}, files=files
    )
    twin = twin_of(experiment, model=read_lab(lab).model, measurements=[measurement])
    outcome = subject.Outcome(experiment, (measurement,), (), (twin,), ())
    whole = subject.Comparison(read_lab(lab), (outcome,), 1, datetime.now(UTC))
    from rigtwin.compare.report.methods import methods
    from rigtwin.compare.report.page import drawn_figures, report

    record = subject_compare_lab.provenance(whole)
    text = methods(whole, record["versions"])
    parsed = Page(report(whole, record, tmp_path, drawn_figures(whole), text))
    (embedded,) = [address for address in parsed.addresses if address.startswith("data:image/")]
    assert len(embedded) < 1_000_000
    assert linked(parsed.addresses)[:2] == ["swing-still.png", "pair/swing-overlay.mp4"]


def test_results_of_experiments_that_are_not_measured_now_are_not_replaced(lab, out):
    before = {name: (out / name).read_bytes() for name in FILES}
    text = (lab / "lab.toml").read_text()
    part = text[text.index("[[experiments]]") :]
    whole = lab / "whole.toml"
    whole.write_text(text.replace("pair/1", "other") + part)
    other = lab / "other.toml"
    other.write_text(text.replace("pair/1", "other"))
    for path, only in ((whole, ["other"]), (other, None)):
        with pytest.raises(BadInput, match=r"holds results of pair/1 .*--out another folder"):
            compare(path, out, only=only, workers=1)
    assert {name: (out / name).read_bytes() for name in FILES} == before


@pytest.mark.slow
@pytest.mark.usefixtures("in_this_process")
def test_a_remark_names_an_experiment_that_was_renamed_in_the_lab_file(lab, compared, tmp_path):
    mine = Path(shutil.copytree(lab, tmp_path / "lab"))
    results = Path(shutil.copytree(compared.files["report.html"].parent, tmp_path / "out"))
    document = results / "deviations.json"  # pretend that the results belong to this folder
    document.write_text(document.read_text().replace(str(lab), str(mine)))
    (mine / "lab.toml").write_text(LAB.replace("pair/1", "pair-1"))
    (said,) = compare(mine, results, workers=1).remarks
    assert said.startswith("pair/1: no longer in lab.toml")
    assert compare(mine, results, workers=1, model=contact_of(tmp_path, "bead-bead")).remarks == ()


@pytest.mark.slow
@pytest.mark.usefixtures("in_this_process")
def test_a_remark_says_that_effects_of_a_model_of_other_contacts_still_act(lab, tmp_path):
    other = contact_of(tmp_path, "D6_ABS-glass")
    (said,) = compare(lab, tmp_path / "out", workers=1, model=other).remarks
    assert "pair/1: model.toml has contacts of D6_ABS-glass and none of bead-bead; its effects (air_drag)" in said


def contact_of(folder, pair):
    """A model with the lab's bead, one contact, and air drag."""
    file, bead = folder / "model.toml", LAB[LAB.index("[particles") : LAB.index("[contacts")]
    effect = "[effects.air_drag]\ndrag_coefficient = 0.47\n"
    file.write_text(f"{bead}\n[contacts.{pair}]\nrestitution = 0.5\n\n{effect}")
    return file


def test_an_experiment_without_any_usable_repetition_is_an_error_that_leaves_old_results(lab, compared, out):
    before = {name: (out / name).read_bytes() for name in FILES}
    text = (lab / "lab.toml").read_text()
    broken = lab / "broken.toml"
    broken.write_text(text.replace('["day1/swing.csv", "day2/swing.csv", "day2/nothing.csv"]', '["day2/nothing.csv"]'))
    with pytest.raises(BadInput, match=r"pair/1: its only repetition could not be measured"):
        compare(broken, out, workers=1)
    assert {name: (out / name).read_bytes() for name in FILES} == before


def test_an_experiment_whose_twin_lacks_its_restitution_is_measured_without_a_twin(lab, tmp_path):
    text = (lab / "lab.toml").read_text()
    unknown = lab / "unknown.toml"
    unknown.write_text(text.replace("restitution = 0.70", ""))
    found = compare(unknown, tmp_path / "out", workers=1)
    (outcome,) = found.outcomes
    lacking = "it needs the restitution of the contact bead-bead (give it under [contacts.bead-bead])"
    assert (outcome.without_twin, outcome.twins) == (lacking, ())
    assert {row.verdict for row in found.deviations} == {"no twin value"}
    assert all(f"no twin: {lacking}" in row.note for row in found.deviations)
    assert found.headline.endswith("without a twin: pair/1.")
    assert lacking in (tmp_path / "out/report.html").read_text()


BARE = """
[[experiments]]
id = "one"
particle = "D6"
wall = "steel"
repetitions = ["clip.avi"]
"""


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ("rig='tilt'\nvariant='slide'\nspeed='1e-4 deg/s'", ["line 9: experiment 1, speed: the twin", "200,000"]),
        ("rig='drop'\ndrop_height='1 m'\ncamera.frame_rate='1e7 Hz'", ["experiment 1: the twin", "frame rate"]),
        ("rig='hopper'\nvariant='slot'\noutlet='2 mm'\ncount=90", ["line 9: experiment 1, outlet: the twin"]),
        ("rig='drum'\ndrum_diameter='9 cm'\nspeed='3 rpm'\ncount=9999", ["line 10: experiment 1, count: the twin"]),
        ("rig='packing'\ncylinder_diameter='65 mm'\ntotal_mass='1 mg'", ["experiment 1, total_mass: the twin", "half"]),
        ("rig='drop'\ncamera.region=[500,0,9,9]", ["line 8: experiment 1, camera.region: ", "80 x 60 px"]),
        ("rig='drop'\ncamera.start='9 s'", ["line 8: experiment 1, camera.start: ", 'start "9 s" lies beyond']),
        ("rig='drop'\ncamera.end='1 frame'", ["line 8: experiment 1, camera.end: ", "2 frames of 20"]),
        (
            "rig='drop'\ncamera.end='15 frames'\n[experiments.files.'clip.avi']\nregion=[500,0,9,9]",
            ['line 10: experiment 1, files."clip.avi".region: ', "80 x 60 px"],
        ),
        (
            "rig='drop'\ncamera.region=[500,0,9,9]\n[experiments.files.'clip.avi']\nend='15 frames'",
            ["line 8: experiment 1, camera.region: "],
        ),
        (
            "rig='drop'\ncamera.region=[500,0,9,9]\n[experiments.files.'clip.avi']\nregion=[500,0,9,9]",
            ['line 10: experiment 1, files."clip.avi".region: '],
        ),
        (
            "rig='drop'\n[experiments.files.'./clip.avi']\nregion=[500,0,9,9]",
            ['line 9: experiment 1, files."./clip.avi".region: '],
        ),
    ],
)
def test_impossible_settings_are_refused_with_their_line_before_anything_is_measured(
    keys, words, tmp_path, monkeypatch
):
    clip = cv2.VideoWriter(str(tmp_path / "clip.avi"), cv2.VideoWriter.fourcc(*"MJPG"), 30, (80, 60))
    for _ in range(20):
        clip.write(np.full((60, 80, 3), 90, np.uint8))
    clip.release()
    (tmp_path / "lab.toml").write_text(BARE + keys)
    monkeypatch.setattr(subject_compare_lab, "measuring", lambda *_, **__: pytest.fail("something was measured"))
    with pytest.raises(BadLabFile) as refusal:
        compare(tmp_path, tmp_path / "out")
    assert str(refusal.value).startswith(f"{tmp_path / 'lab.toml'}, line ")
    assert all(word in str(refusal.value) for word in words), str(refusal.value)
    assert not (tmp_path / "out").exists()


def test_a_count_of_the_command_line_that_no_drum_holds_is_no_fault_of_the_lab(tmp_path):
    (tmp_path / "clip.avi").write_bytes(b"never opened")
    (tmp_path / "lab.toml").write_text(BARE + "rig='drum'\ndrum_diameter='9 cm'\nspeed='3 rpm'")
    with pytest.raises(BadInput, match=r"^--count: one: the twin cannot be run: 9999 ") as refusal:
        compare(tmp_path, tmp_path / "out", count=9999)
    assert not isinstance(refusal.value, BadLabFile)


def test_an_interrupted_comparison_does_not_wait_for_its_measuring_processes(lab, tmp_path):
    workers, others = [], set(multiprocessing.active_children())

    def interrupted():
        with measuring(read_lab(lab).experiments, tmp_path, workers=2):
            workers.extend(set(multiprocessing.active_children()) - others)
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert workers
    for worker in workers:
        deadline = time.monotonic() + 60  # not by `join`: the pool's own thread may be the one that learns how it ended
        while worker.exitcode is None and time.monotonic() < deadline:
            time.sleep(0.01)
        assert worker.exitcode == -signal.SIGTERM  # terminated; a worker that finishes exits with 0


@pytest.mark.usefixtures("in_this_process")
def test_an_interrupted_comparison_continues_with_its_kept_twins(tmp_path):
    bed_lab(tmp_path)

    def impatient(what, _done, _whole):
        if what == "settling":
            raise KeyboardInterrupt

    out = tmp_path / "out"
    with pytest.raises(KeyboardInterrupt) as stop:
        compare(tmp_path, out, impatient, workers=1, threads=1)
    (kept,) = (out / "unfinished").iterdir()
    assert str(kept) in stop.value.__notes__[0]
    looks, more = [], []
    whole = compare(tmp_path, tmp_path / "whole", lambda *_: looks.append(1), workers=1, threads=1)
    resumed = compare(tmp_path, out, lambda *_: more.append(1), workers=1, threads=1)
    assert len(more) < len(looks)
    values = [[q.value for q in one.outcomes[0].twins[0].evaluation.quantities] for one in (whole, resumed)]
    assert values[0] == values[1]
    assert not (out / "unfinished").exists()

    with pytest.raises(KeyboardInterrupt):
        compare(tmp_path, out, impatient, workers=1, threads=1)
    kept.write_bytes(kept.read_bytes()[:1000])  # damaged: starts again
    (out / "unfinished/notes.txt").write_text("mine")
    again = compare(tmp_path, out, workers=1, threads=1)
    assert [q.value for q in again.outcomes[0].twins[0].evaluation.quantities] == values[0]
    assert [path.name for path in (out / "unfinished").iterdir()] == ["notes.txt"]


@pytest.mark.usefixtures("in_this_process")
def test_several_runs_of_a_twin_are_kept_and_an_interrupted_comparison_continues(tmp_path, monkeypatch):
    lab, out = bed_lab(tmp_path), tmp_path / "out"

    def impatient(what, done, _whole):
        if what == "running" and done:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt) as stop:
        compare(lab, out, impatient, workers=1, runs=3)
    assert stop.value.__notes__ == [f"1 of 3 runs are kept in {out / 'runs'}; the same command runs the others."]
    with Store(out / "runs", create=False) as store:
        (first,) = store.rows()
    found = compare(lab, out, workers=1, runs=3)
    with Store(out / "runs", create=False) as store:
        rows = store.rows()
    assert len(rows) == 3
    assert first.finished == rows[0].finished

    (experiment,) = read_lab(lab).experiments
    model = read_lab(lab).model
    alone = [twin_of(experiment, model=model, seed=seed, threads=1) for seed in (1, 2, 3)]
    (outcome,) = found.outcomes
    for kept, twin in zip(outcome.twins, alone, strict=True):
        assert document(untimed(kept.to_json())) == document(untimed(twin.to_json()))
    assert outcome.shapes[0].row("one")["simulated_n"] == sum(len(twin.profiles) for twin in alone)

    tables = [(out / name).read_bytes() for name in ("deviations.csv", "observations.csv")]
    monkeypatch.setattr("rigtwin.compare.campaign.runners.spawned", lambda *_: pytest.fail("a twin was run"))
    compare(lab, out, workers=1, runs=3)
    assert [(out / name).read_bytes() for name in ("deviations.csv", "observations.csv")] == tables


def bed_lab(folder):
    (folder / "bed.csv").write_text("x_m,height_m\n" + "\n".join(f"{x / 1e3},0.03" for x in range(-12, 13)))
    bare = BARE.replace("clip.avi", "bed.csv").replace("steel", "PMMA")
    (folder / "lab.toml").write_text(bare + "rig='packing'\ncylinder_diameter='30 mm'\ncount=80")
    return folder


def untimed(settings):
    """Settings without what depends on the speed of the machine."""
    return {
        name: untimed(value) if isinstance(value, dict) else value
        for name, value in settings.items()
        if "second" not in name
    }


@pytest.mark.usefixtures("in_this_process")
def test_a_run_of_several_that_fails_is_named(tmp_path, capsys):
    lab = bed_lab(tmp_path)
    (lab / "lab.toml").write_text((lab / "lab.toml").read_text().replace("count=80", "count=3"))
    assert run(["compare", str(lab), "--runs", "2", "--json"]) == 0
    (one,) = json.loads(capsys.readouterr().out)["experiments"]
    assert one["without_twin"].startswith("the twin failed: a count of 3 makes no bed")
    assert one["twins"] == []


@pytest.mark.usefixtures("in_this_process")
def test_a_seed_that_fails_beside_others_is_named_with_its_reason(tmp_path, monkeypatch, capsys):
    run_all = subject_compare_lab.run_all

    def without_first(runs, *args, **more):
        failures = {one.name: "does not fit into memory." for one in runs[:1]}
        return replace(run_all(runs[1:], *args, **more), failures=failures)

    monkeypatch.setattr(subject_compare_lab, "run_all", without_first)
    assert run(["compare", str(bed_lab(tmp_path)), "--runs", "2", "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    (one,) = document["experiments"]
    assert "without_twin" not in one
    assert "the run of the twin with seed 1 failed and is not compared: does not fit into memory" in one["warnings"]
    assert {row["simulated_n"] for row in document["deviations"]} == {1}
    with (tmp_path / "out/observations.csv").open() as file:
        runs = {row["repetition"] for row in csv.DictReader(file) if row["origin"] == "simulated"}
    assert runs == {"twin, seed 2"}


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--cluster", "tcp://host:8786", "--threads", "2"], "--threads: is for this machine"),
        (["--cluster", "abc"], "--cluster: 'abc' is neither"),
    ],
)
def test_a_cluster_that_cannot_be_used_is_refused_before_anything_is_written(tmp_path, capsys, options, words):
    assert run(["compare", str(bed_lab(tmp_path)), *options]) == 2
    assert words in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_a_cluster_without_twins_of_many_particles_is_refused(lab, capsys):
    assert run(["compare", str(lab), "--cluster", "tcp://host:8786"]) == 2
    assert "--cluster: no experiment has many particles (pair/1)" in capsys.readouterr().err


def test_ids_that_make_no_folder_names_still_get_folders_of_their_own(lab):
    from dataclasses import replace

    from rigtwin.compare.measure_repetitions import folders

    (experiment,) = read_lab(lab).experiments
    ids = ["a/b", "a_b", "A b", "..", "../../etc", "größe 1"]
    names = folders([replace(experiment, id=name) for name in ids])
    assert len({name.lower() for name in names}) == len(ids)
    assert all(Path(name).parts == (name,) and name not in {".", ".."} for name in names)


def test_files_are_replaced_all_or_none(tmp_path):
    write_together(tmp_path, {"a.csv": "old", "b.csv": "old"})
    with pytest.raises(TypeError):
        write_together(tmp_path, {"a.csv": "new", "b.csv": 3})
    assert {path.name: path.read_text() for path in tmp_path.iterdir()} == {"a.csv": "old", "b.csv": "old"}


def test_a_folder_in_the_place_of_a_result_is_found_before_anything_is_replaced(tmp_path):
    write_together(tmp_path, {"a.csv": "old"})
    (tmp_path / "b.csv").mkdir()
    with pytest.raises(IsADirectoryError) as refused:
        write_together(tmp_path, {"a.csv": "new", "b.csv": "new"})
    assert refused.value.filename == str(tmp_path / "b.csv")
    assert (tmp_path / "a.csv").read_text() == "old"


def test_json_holds_no_nan_and_no_infinity():
    text = document({"a": float("nan"), "b": [np.float64("inf"), np.int64(3)], "c": Path("x"), "d": np.array([1.0])})
    assert json.loads(text, parse_constant=pytest.fail) == {"a": None, "b": [None, 3], "c": "x", "d": [1.0]}


@pytest.mark.usefixtures("in_this_process")
def test_a_rejected_repetition_is_not_measured_and_listed_with_its_reason(lab, tmp_path):
    for name in ("day1", "day2"):
        shutil.copytree(lab / name, tmp_path / name)
    rejected = '[experiments.files."day2/nothing.csv"]\nrejected = "the thread caught"\n'
    (tmp_path / "lab.toml").write_text(LAB + rejected)
    result = compare(tmp_path, tmp_path / "out", workers=1)
    (outcome,) = result.outcomes
    assert [each.source.parent.name for each in outcome.measurements] == ["day1", "day2"]
    assert outcome.failures == ()
    assert "nothing.csv is rejected in lab.toml: the thread caught" in outcome.warnings
    assert "nothing.csv is rejected in lab.toml: the thread caught" in result.files["report.html"].read_text()
    listed = result.to_json()["experiments"][0]["rejected"]
    assert listed == [{"file": str(tmp_path / "day2/nothing.csv"), "reason": "the thread caught"}]


def test_a_lab_whose_repetitions_are_all_rejected_is_refused_before_any_work(lab, tmp_path):
    shutil.copytree(lab / "day1", tmp_path / "day1")
    one = LAB.replace(', "day2/swing.csv", "day2/nothing.csv"', "")
    (tmp_path / "lab.toml").write_text(f'{one}[experiments.files."day1/swing.csv"]\nrejected = "dark"\n')
    with pytest.raises(BadInput, match=r"lab\.toml, line 20: experiment 1, files: all repetitions are rejected"):
        compare(tmp_path, tmp_path / "out", workers=1)
    assert not (tmp_path / "out").exists()
