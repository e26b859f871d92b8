"""All repetitions of a lab by one command; what was measured is kept and not measured again."""

import json
import math
import re
import shutil
from concurrent.futures import Future
from contextlib import nullcontext
from dataclasses import asdict, fields, replace
from pathlib import Path

import cv2
import numpy as np
import pytest

import rigtwin
from rigtwin.cli import run
from rigtwin.compare.kept_measurements import KeptMeasurements
from rigtwin.compare.measure_lab import measure_lab
from rigtwin.compare.measure_repetitions import known
from rigtwin.compare.result_files import plain
from rigtwin.lab.checksums import sha256
from rigtwin.lab.errors import BadInput, BadLabFile, Mark
from rigtwin.lab.file.lab_file import read_lab
from rigtwin.lab.records import Profile, Series

pytestmark = pytest.mark.usefixtures("in_this_process")

LAB = """\
[[experiments]]
id = "drop"
rig = "drop"
particle = "D6"
wall = "steel"
repetitions = ["drops/"]

[[experiments]]
id = "bed"
rig = "packing"
particle = "D6"
wall = "PMMA"
cylinder_diameter = "30 mm"
count = 80
repetitions = ["bed.csv"]
"""


def falls(restitution, clock=1.0):
    """The track of a bead that falls from 0.3 m and bounces once, by a clock that runs `clock` times as fast."""
    rows, impact = ["time_s,x_m,y_m"], math.sqrt(2 * 0.3 / 9.81)
    for k in range(150):
        since = k / 240 - impact
        height = 0.3 - 9.81 * (k / 240) ** 2 / 2
        if since > 0:
            height = restitution * 9.81 * impact * since - 9.81 * since**2 / 2
        rows.append(f"{clock * k / 240:.6f},0,{height:.7f}")
    return "\n".join(rows)


@pytest.fixture
def lab(tmp_path):
    folder = tmp_path / "my-lab"
    (folder / "drops").mkdir(parents=True)
    for number in (10, 2, 1):
        (folder / "drops" / f"r{number}.csv").write_text(falls(0.5 + number / 100))
    (folder / "bed.csv").write_text("x_m,height_m\n" + "\n".join(f"{x / 1e3},0.03" for x in range(-12, 13)))
    (folder / "lab.toml").write_text(LAB)
    return folder


@pytest.fixture
def measured(monkeypatch):
    """Names of the files that are measured, in their order."""
    import rigtwin.compare.measure_repetitions as subject

    names, measure = [], subject.measure_repetition

    def watched(experiment, views, out):
        names.append(views[0].name)
        return measure(experiment, views, out)

    monkeypatch.setattr(subject, "measure_repetition", watched)
    return names


def restitution(found):
    return [
        row["value"]
        for row in found.rows
        if (row["quantity"], row["method"], row["bounce"]) == ("restitution_wall", "velocity", 1)
    ]


def test_all_repetitions_are_measured_once_and_again_only_what_has_changed(lab, tmp_path, measured):
    out = tmp_path / "out"
    first = measure_lab(lab, out)
    assert sorted(measured) == ["bed.csv", "r1.csv", "r10.csv", "r2.csv"]
    assert restitution(first) == pytest.approx([0.51, 0.52, 0.60], abs=0.003), "in natural order"
    tables = (out / "measurements.csv").read_bytes()

    measured.clear()
    again = measure_lab(lab, out)
    assert measured == []
    assert [item.to_json() for one in again.measured for item in one.measurements] == [
        item.to_json() for one in first.measured for item in one.measurements
    ]
    assert (out / "measurements.csv").read_bytes() == tables

    (lab / "drops" / "r2.csv").write_text(falls(0.7))
    (lab / "drops" / "r11.csv").write_text(falls(0.4))
    assert restitution(measure_lab(lab, out)) == pytest.approx([0.51, 0.70, 0.60, 0.40], abs=0.003)
    assert sorted(measured) == ["r11.csv", "r2.csv"]

    measured.clear()
    measure_lab(lab, out, only=["bed"], again=True)
    assert measured == ["bed.csv"]


def test_a_line_says_how_many_repetitions_are_measured_and_how_many_are_kept(lab, tmp_path, capsys):
    def said(*options):
        assert run(["measure", str(lab), "--out", str(tmp_path / "out"), *options]) == 0
        return capsys.readouterr().out

    assert "3 repetitions measured.\n" in said("--only", "drop")
    assert "1 repetition measured, 3 kept from before; --again measures all.\n" in said()
    assert "0 repetitions measured, 4 kept from before" in said()


class Waiting:
    """A pool that does the first two tasks and never comes to the others."""

    def __init__(self) -> None:
        self.asked = 0

    def submit(self, work, *arguments):
        job = Future()
        self.asked += 1
        if self.asked <= 2:
            job.set_result(work(*arguments))
        return job


def test_what_was_measured_before_an_interruption_is_kept_and_counted(lab, tmp_path, measured, monkeypatch):
    import rigtwin.compare.measure_repetitions as subject

    def impatient(_what, _done, _whole):
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(subject, "spawned", lambda *_, **__: nullcontext(Waiting()))
        with pytest.raises(KeyboardInterrupt) as stop:
            measure_lab(lab, tmp_path / "out", impatient)
        assert stop.value.__notes__ == ["2 of 4 measurements are kept; the same command measures the others."]
        assert len(measured) == 2
        with pytest.raises(KeyboardInterrupt) as stop:
            measure_lab(lab, tmp_path / "out", impatient, only=["drop"], again=True)
    assert stop.value.__notes__ == [
        "2 of 3 measurements are kept; the same command without --again measures the others."
    ]
    measured.clear()
    measure_lab(lab, tmp_path / "out")
    assert len(measured) in (1, 2)


def test_measurements_are_kept_while_other_work_goes_on(lab, tmp_path, measured, monkeypatch):
    import rigtwin.compare.measure_repetitions as subject

    looks = []
    with monkeypatch.context() as patch:
        patch.setattr(subject, "spawned", lambda *_, **__: nullcontext(Waiting()))
        with subject.measuring(read_lab(lab).experiments, tmp_path / "out") as pending:
            pending.keeping(lambda *step: looks.append(step))("settling", 1, 2)
    assert looks == [("settling", 1, 2)]
    assert len(measured) == 2
    measure_lab(lab, tmp_path / "out")
    assert len(set(measured)) == len(measured) == 4


def test_a_warning_of_many_files_is_one_line_and_a_scatter_in_the_uncertainty_is_named(lab, tmp_path, capsys):
    assert run(["measure", str(lab), "--out", str(tmp_path / "out")]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert said.count("does not say how well its scale is known") == 1
    assert "r1.csv and 2 others: the table does not say" in said
    assert (
        "note: bed, Bed height, Bulk density: 1 measured repetition: a scatter of 1 % is in the uncertainty (Hl" in said
    )
    assert "no twin" not in said


def test_measuring_one_experiment_leaves_the_others_in_the_tables(lab, tmp_path, measured, capsys):
    out = tmp_path / "out"
    measure_lab(lab, out)
    tables = [(out / name).read_bytes() for name in ("measurements.csv", "measurements.json")]
    found = measure_lab(lab, out, only=["bed"])
    assert {row["experiment"] for row in found.rows} == {"bed"}
    assert not found.warnings
    assert [(out / name).read_bytes() for name in ("measurements.csv", "measurements.json")] == tables

    measured.clear()
    (lab / "drops" / "r2.csv").write_text(falls(0.7))
    assert run(["measure", str(lab), "--out", str(out), "--only", "bed"]) == 0
    assert not measured
    assert "drop: not in measurements.csv" in " ".join(capsys.readouterr().out.split())
    assert "drop" not in (out / "measurements.csv").read_text()


def test_a_setting_that_counts_in_measuring_makes_it_new_and_one_of_the_twin_does_not(lab, tmp_path, measured):
    out, path = tmp_path / "out", lab / "lab.toml"
    measure_lab(lab, out)
    measured.clear()
    path.write_text(
        LAB.replace('wall = "PMMA"', 'wall = "glass"').replace('"drop"\nparticle', '"drop"\nbounces = 2\nparticle')
    )
    measure_lab(lab, out)
    assert measured == []
    path.write_text(LAB.replace("count = 80", "count = 90"))
    measure_lab(lab, out)
    assert measured == ["bed.csv"]


def test_what_is_said_of_one_file_of_a_folder_counts_for_that_file_alone(lab, tmp_path, measured):
    out, path = tmp_path / "out", lab / "lab.toml"
    measure_lab(lab, out)
    measured.clear()
    drop, bed = LAB.split("\n\n")
    path.write_text(f'{drop}\n[experiments.files."drops/r2.csv"]\nrejected = "a draught"\n\n{bed}')
    assert restitution(measure_lab(lab, out)) == pytest.approx([0.51, 0.60], abs=0.003)
    assert measured == []
    path.write_text(f'{drop}\n[experiments.files."drops/r2.csv"]\nend = "0.45 s"\n\n{bed}')
    measure_lab(lab, out)
    assert measured == ["r2.csv"]


def test_rejected_files_are_listed_and_a_lab_without_others_is_refused(lab, tmp_path, capsys):
    drop, bed = LAB.split("\n\n")
    tables = [f'[experiments.files."drops/r{number}.csv"]\nrejected = "a draught"' for number in (1, 2, 10)]
    (lab / "lab.toml").write_text("\n".join([drop, *tables[:1]]) + f"\n\n{bed}")
    found = measure_lab(lab, tmp_path / "out")
    assert found.warnings[0] == "drop: r1.csv is rejected in lab.toml: a draught"
    (one, _) = found.to_json()["experiments"]
    assert one["rejected"] == [{"file": str(lab / "drops/r1.csv"), "reason": "a draught"}]

    (lab / "lab.toml").write_text("\n".join([drop, *tables]) + f"\n\n{bed}")
    for command in ("measure", "compare"):
        assert run([command, str(lab), "--out", str(tmp_path / command)]) == 2
        assert "experiment 1, files: all repetitions are rejected; accept one of them." in capsys.readouterr().err


def test_kept_measurements_are_the_same_to_the_last_digit(lab, tmp_path):
    experiment = read_lab(lab).experiments[0]
    out = tmp_path / "out"
    found = measure_lab(lab, out).measured[0].measurements[0]
    kept = KeptMeasurements(out)
    views = experiment.repetitions[0]
    again = kept.find(kept.key(experiment, views, known(experiment), out / "drop"), views)
    assert plain(asdict(again)) == plain(asdict(found))
    for mine, other in zip(again.tracks, found.tracks, strict=True):
        np.testing.assert_array_equal(mine.position, other.position)

    full = replace(
        found,
        profiles=(Profile(np.array([0.0, 0.1]), np.array([0.02, np.nan]), np.array([1e-4, 2e-4]), (0.0, 0.1), "side"),),
        series=(Series(np.array([0.0, 1 / 3]), np.array([0.1, 0.2]), "mass_left", "kg"),),
        marks=(
            Mark("bead", [(1 / 3, 2.0), (4.0, 5.5)], 6.25, "track", frames=(3, 4), view=1),
            Mark("base", ((0.0, 1.0),)),
        ),
        warnings=("it is dark",),
        camera={"frame_rate_hz": 240.0},
        frame_times=(0.0, 1 / 3),
        table={"kind": "track"},
    )
    assert all(getattr(full, one.name) for one in fields(full)), "nothing is left empty"
    kept.keep("full", full)
    assert plain(asdict(kept.find("full", views))) == plain(asdict(full))


def test_a_setting_that_is_changed_back_gives_the_pictures_of_its_own_measurement(lab, tmp_path, measured):
    out, path = tmp_path / "out", lab / "lab.toml"
    other = LAB.replace(
        'particle = "D6"\nwall = "steel"', 'particle = "D6"\nwall = "steel"\ncamera = { end = "0.45 s" }'
    )

    def plots():
        found = measure_lab(lab, out).measured[0].measurements
        return [one.files["plot"].read_bytes() for one in found]

    first = plots()
    path.write_text(other)
    assert plots() != first
    measured.clear()
    path.write_text(LAB)
    assert [_curves(plot) for plot in plots()] == [_curves(plot) for plot in first]
    assert sorted(measured) == ["r1.csv", "r10.csv", "r2.csv"]
    measured.clear()
    plots()
    assert measured == []


def test_files_of_a_kept_measurement_are_those_of_its_own_clip_after_the_list_has_changed(lab, tmp_path, measured):
    out, path = tmp_path / "out", lab / "lab.toml"
    for number in (1, 2, 3):
        (lab / f"d{number}").mkdir()
        (lab / f"d{number}" / "r01.csv").write_text(falls(0.5 + number / 20))

    def plots(*clips):
        path.write_text(LAB.replace('["drops/"]', json.dumps([f"d{clip}/r01.csv" for clip in clips])))
        found = measure_lab(lab, out).measured[0].measurements
        assert [one.source.parent.name for one in found] == [f"d{clip}" for clip in clips]
        return {clip: _curves(one.files["plot"].read_bytes()) for clip, one in zip(clips, found, strict=True)}

    before = plots(1, 2)
    after = plots(2, 3)
    assert after[2] == before[2]
    assert after[3] not in (after[2], before[1])
    measured.clear()
    assert plots(2, 3) == after
    assert measured == []


def test_an_experiment_under_another_name_has_its_own_files(lab, tmp_path):
    out, path = tmp_path / "out", lab / "lab.toml"
    one, two = (f'[[experiments]]\nid = "{name}"\nrig = "drop"\nparticle = "D6"\nwall = "steel"\n' for name in "ab")
    (lab / "other").mkdir()
    (lab / "other" / "r1.csv").write_text(falls(0.8))
    path.write_text(f'{one}repetitions = ["drops/r1.csv"]\n')
    measure_lab(lab, out)
    path.write_text(f'{two}repetitions = ["drops/r1.csv"]\n{one}repetitions = ["other/r1.csv"]\n')
    for _ in range(2):
        found = [each.measurements[0].files["plot"] for each in measure_lab(lab, out).measured]
        assert found == [out / "b" / "r1-plot.svg", out / "a" / "r1-plot.svg"]


def _curves(plot):
    """The lines of a plot, without the names that each writing makes anew."""
    return re.findall(rb'<path d="([^"]+)"', plot)


@pytest.mark.parametrize("damage", ["json", "npz", "packed", "digits", "arrays", "pictures"])
def test_what_is_damaged_changed_or_has_lost_its_pictures_is_measured_again(lab, tmp_path, measured, damage):
    out = tmp_path / "out"
    found = measure_lab(lab, out)
    measured.clear()
    if damage == "pictures":
        for path in found.measured[1].measurements[0].files.values():
            path.unlink(missing_ok=True)
    elif damage == "packed":
        for path in (out / "measured").glob("*.npz"):
            stored = path.read_bytes()
            path.write_bytes(stored[:60] + bytes(40) + stored[100:])
    elif damage == "digits":
        for path in (out / "measured").glob("*.json"):
            path.write_text(
                re.sub(r'"value": 0\.(\d)', lambda found: f'"value": 0.{(int(found[1]) + 1) % 10}', path.read_text())
            )
    elif damage == "arrays":
        files = sorted((out / "measured").glob("*.npz"))
        for path, stored in zip(files, [path.read_bytes() for path in files[1:] + files[:1]], strict=True):
            path.write_bytes(stored)
    else:
        for path in (out / "measured").glob(f"*.{damage}"):
            path.write_bytes(path.read_bytes()[:40])
    measure_lab(lab, out)
    assert sorted(measured) == (["bed.csv"] if damage == "pictures" else ["bed.csv", "r1.csv", "r10.csv", "r2.csv"])


def test_a_kept_document_shows_no_file_outside_the_folder_of_results(lab, tmp_path, measured):
    out = tmp_path / "out"
    measure_lab(lab, out)
    (tmp_path / "secret.png").write_text("secret")
    secret = {"path": "../secret.png", "sha256": sha256(tmp_path / "secret.png")}
    for path in (out / "measured").glob("*.json"):
        document = json.loads(path.read_text())
        path.write_text(json.dumps({**document, "files": {"still": secret}}))
    measured.clear()
    again = measure_lab(lab, out)
    assert len(measured) == 4
    assert "secret" not in json.dumps(again.to_json())


def test_a_repetition_that_cannot_be_measured_is_named_and_not_tried_again(lab, tmp_path, measured, capsys):
    (lab / "drops" / "r3.csv").write_text("time_s,x_m,y_m\n0,0,0.1\n0.01,0,0.1\n")
    assert run(["measure", str(lab), "--out", str(tmp_path / "out")]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "drop: r3.csv was left out: " in said
    (mean,) = [row for row in measure_lab(lab, tmp_path / "out").means if (row.method, row.bounce) == ("velocity", 1)]
    assert (mean.measured, mean.measured_n) == (pytest.approx(1.63 / 3, abs=0.003), 3)
    measured.clear()
    assert run(["measure", str(lab / "lab.toml"), "--out", str(tmp_path / "out"), "--json"]) == 0
    assert measured == []
    drops, _ = json.loads(capsys.readouterr().out)["experiments"]
    assert [len(drops[what]) for what in ("measurements", "failures")] == [3, 1]


def test_a_doubtful_repetition_that_no_mean_counts_is_named(lab, tmp_path, capsys):
    (lab / "drops" / "r3.csv").write_text(falls(0.5, clock=0.8))
    assert run(["measure", str(lab), "--out", str(tmp_path / "out")]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "drop: r3.csv is doubtful and excluded from the mean of" in said


def test_copies_that_differ_in_their_bytes_count_once_in_a_mean_and_are_named_in_one_line(lab, tmp_path, capsys):
    film = falls(0.51)
    for number in range(1, 9):
        (lab / "drops" / f"r{number}.csv").write_text(film + "\n" * number)
    (lab / "drops" / "r10.csv").write_text(falls(0.53))
    found = measure_lab(lab, tmp_path / "out", only=["drop"])
    said = [one for one in found.warnings if "copies of one clip" in one]
    assert len(said) == 1
    assert said[0].startswith(
        "drop: r2.csv and 6 others are doubtful and excluded from the mean of Restitution on the wall"
    )
    assert said[0].endswith(": the same result to the last digit as r1.csv: copies of one clip?")
    first = next(one for one in found.means if one.quantity == "restitution_wall")
    assert (first.measured_n, first.doubtful) == (2, "")
    assert first.measured == pytest.approx(0.52, abs=0.003)
    doubtful = [row["repetition"] for row in found.rows if "copies of one clip?" in row["doubtful"]]
    assert set(doubtful) == {f"drops/r{number}.csv" for number in range(2, 9)}
    again = measure_lab(lab, tmp_path / "out", only=["drop"])
    assert again.warnings == found.warnings
    assert again.rows == found.rows


def test_a_failed_check_stands_beside_rows_that_do_not_rest_on_it(lab, capsys):
    for number in (1, 2, 10):
        (lab / "drops" / f"r{number}.csv").write_text(falls(0.5 + number / 100, clock=1.3))
    assert run(["measure", str(lab), "--only", "drop"]) == 0
    out = capsys.readouterr().out
    ratios = {line.split("(")[1].split(")")[0]: line for line in out.splitlines() if "Restitution" in line}
    assert {method: line.split("│")[-2].strip() for method, line in ratios.items()} == {
        "velocity": "doubtful",
        "height": "check failed",
    }
    assert out.count("instead of 9.81") == 1
    assert {row.failed_check for row in measure_lab(lab, lab / "out", only=["drop"]).means} == {"gravity"}


def test_a_check_that_failed_in_a_repetition_that_is_left_out_does_not_stand_beside_the_mean(lab, tmp_path):
    for number in (1, 2):
        (lab / "drops" / f"r{number}.csv").write_text(falls(0.5 + number / 100))
    (lab / "drops" / "r10.csv").write_text(falls(0.6, clock=1.3))
    rows = {(row.quantity, row.method): row for row in measure_lab(lab, tmp_path / "out", only=["drop"]).means}
    velocity, height = (rows["restitution_wall", method] for method in ("velocity", "height"))
    assert velocity.measured_n == 2  # the third is doubtful
    assert not velocity.failed_check
    assert height.measured_n == 3
    assert height.failed_check == "gravity"


def test_sizes_that_no_twin_can_have_are_named_where_only_the_media_are_measured(tmp_path):
    keys = 'id = "flow"\nrig = "hopper"\nparticle = "D6"\nwall = "PMMA"\nvariant = "slot"\nrepetitions = ["flow.csv"]\n'
    shares = (200 * max(0.0, min(1.0, 1.25 - k / 120)) for k in range(200))
    (tmp_path / "flow.csv").write_text(
        "time_s,mass_left_g\n" + "\n".join(f"{k / 100:.2f},{share:.3f}" for k, share in enumerate(shares))
    )
    for outlet, words in (
        ("2 mm", "outlet: the twin cannot be run: 2 mm lets no bead of 6.2 mm through"),
        ("25 mm", ""),
    ):
        (tmp_path / "lab.toml").write_text(f'[[experiments]]\n{keys}outlet = "{outlet}"\ncount = 90\n')
        found = [said for said in measure_lab(tmp_path, tmp_path / "out").warnings if "the twin cannot be run" in said]
        assert [said.startswith(f"flow: {words}") for said in found] == [True] * bool(words)


def test_a_filling_that_is_ten_times_too_heavy_or_too_light_for_the_bed_seen_makes_its_flow_doubtful(tmp_path):
    shutil.copy(Path(__file__).parents[2] / "sample_media/seven_rigs/hopper.mp4", tmp_path)
    keys = 'id = "flow"\nrig = "hopper"\nparticle = "D6"\nwall = "PMMA"\nvariant = "slot"\noutlet = "25 mm"\n'
    keys += 'bin_width = "60 mm"\ndepth = "40 mm"\nrepetitions = ["hopper.mp4"]\ncamera.frame_rate = "120 Hz"\n'
    # 400 beads of 0.071 g were drawn
    for mass, doubtful in (("2.84 g", True), ("28.4 g", False), ("284 g", True)):
        (tmp_path / "lab.toml").write_text(f'[[experiments]]\n{keys}total_mass = "{mass}"\n')
        found = measure_lab(tmp_path, tmp_path / "out", workers=1)
        (flow,) = (row for row in found.means if row.quantity == "mass_flow_rate")
        assert (f"and {mass} are stated or follow" in flow.doubtful) == doubtful
        (time,) = (row for row in found.means if row.quantity == "discharge_time")
        assert not time.doubtful


def test_a_mean_has_the_same_uncertainty_with_and_without_a_comparison(lab, tmp_path):
    (lab / "lab.toml").write_text(LAB.replace('particle = "D6"', 'particle = "own"'))
    with (lab / "lab.toml").open("a") as file:
        file.write('[particles.own]\nmaterial = "wood_ash"\ndiameter = "6 mm"\ndensity = "568 kg/m^3"\n')
    measured = measure_lab(lab, tmp_path / "measured").means
    compared = rigtwin.open_lab(lab).compare(out=tmp_path / "compared").deviations
    assert all("contact" in row.note for row in compared), "without a twin"

    def uncertainties(rows):
        return [(row.experiment, row.quantity, row.method, row.bounce, row.measured_std_uncertainty) for row in rows]

    assert uncertainties(compared) == uncertainties(measured)


def test_the_picture_that_a_kept_failure_names_is_there(lab, tmp_path, measured):
    out = tmp_path / "out"
    cv2.imwrite(str(lab / "bed.png"), np.random.default_rng(1).normal(120, 5, (300, 400)).astype(np.uint8))
    (lab / "lab.toml").write_text(LAB.replace("bed.csv", "bed.png"))

    def failure():
        with pytest.raises(BadInput, match="bed: its only repetition could not be measured") as refused:
            measure_lab(lab, out, only=["bed"])
        return str(refused.value)

    picture = out / "bed" / "bed-seen.png"
    assert f"{picture} shows what was seen" in failure()
    assert f"{picture} shows what was seen" in failure()
    assert measured == ["bed.png"]
    picture.unlink()  # as by a measurement with other settings that succeeds
    failure()
    assert picture.is_file()
    assert measured == ["bed.png", "bed.png"]


def test_compare_uses_what_measure_has_kept(lab, measured):
    opened = rigtwin.open_lab(lab)
    found = opened.measure()
    assert f"{len(found.rows)} numbers: to_frame()" in repr(found)
    assert len(repr(found)) < 200
    frame = found.to_frame()
    assert set(frame["repetition"]) == {"drops/r1.csv", "drops/r2.csv", "drops/r10.csv", "bed.csv"}
    measured.clear()
    compared = opened.compare(only="drop")
    assert measured == []
    assert len(compared.outcomes[0].measurements) == 3
    alone = [one for one in found.means if one.experiment == "drop"]
    assert [(one.measured, one.measured_std_uncertainty, one.scatter) for one in alone] == [
        (one.measured, one.measured_std_uncertainty, one.scatter) for one in compared.deviations
    ]
    assert {one.scatter is None for one in alone} == {True, False}
    opened.compare(only="drop", again=True)
    assert len(measured) == 3


def test_a_name_that_is_neither_rig_nor_lab_is_refused(tmp_path, capsys):
    assert run(["measure", "nowhere"]) == 2
    assert "nowhere: is neither a rig nor a lab folder; rigs are drop" in capsys.readouterr().err
    with pytest.raises(BadInput, match="there is no 'lab'; known are drop"):
        rigtwin.measure("lab", tmp_path)
    with pytest.raises(BadLabFile, match="no such file"):
        measure_lab(tmp_path, tmp_path / "out")
