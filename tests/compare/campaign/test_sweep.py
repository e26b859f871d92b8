"""Sweeps: parameters by name, designs, tables, figures, and the measured value beside the twins."""

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from rigtwin.cli import run
from rigtwin.commands.sweep import show
from rigtwin.compare.campaign.campaign import run_all
from rigtwin.compare.campaign.sweep import Sweep, lab_setting, stated_setting
from rigtwin.compare.campaign.sweep_figures import figures
from rigtwin.compare.campaign.twin_runs import quantities_of, twin_from, twin_run
from rigtwin.compare.campaign.vary import at, parse, points
from rigtwin.compare.deviation import over_views
from rigtwin.compare.result_files import claimed
from rigtwin.compare.twins.matched import twin_of
from rigtwin.lab.errors import BadInput
from rigtwin.lab.materials import sized
from rigtwin.lab.reference import hlosta2020
from rigtwin.lab.size_distributions import uniform

BED = ["--set", "cylinder_diameter=40mm", "--wall", "PMMA", "--count", "120"]


@pytest.fixture
def bed():
    return stated_setting("packing", ["cylinder_diameter=40mm", "count=120"], particle="D6", wall="PMMA")


@pytest.mark.parametrize(
    ("rig", "stated"),
    [
        ("packing", ["cylinder_diameter=40mm", "count=120"]),
        ("drum", ["drum_diameter=50mm", "depth=20mm", "fill=0.4", "speed=60rpm"]),
    ],
)
@pytest.mark.usefixtures("in_this_process")
def test_a_twin_as_a_run_gives_what_the_twin_itself_gives(rig, stated, tmp_path):
    experiment, model = stated_setting(rig, stated, particle="D6", wall="PMMA")
    run_all([twin_run("one", experiment, model, seed=3)], tmp_path)
    kept = run_all([twin_run("one", experiment, model, seed=3)], tmp_path, only_kept=True).results["one"]
    twin, same = twin_of(experiment, model=model, seed=3, threads=1), twin_from(kept)
    assert same.evaluation.quantities == twin.evaluation.quantities
    assert [one.to_json() for one in same.evaluation.checks] == [one.to_json() for one in twin.evaluation.checks]
    assert quantities_of(kept) == over_views(twin.evaluation.quantities)
    for mine, theirs in zip((*same.profiles, *same.series), (*twin.profiles, *twin.series), strict=True):
        for name, value in vars(theirs).items():
            np.testing.assert_array_equal(getattr(mine, name), value)
    assert same.assumptions == twin.assumptions
    assert len(same.profiles[0].x) > 10


@pytest.mark.parametrize(
    ("entries", "advice"),
    [
        ('rig = "drop"', "state drop_height and frame_rate of [experiments.camera] in lab.toml."),
        ('rig = "drop"\ndrop_height = "25 cm"', "state frame_rate of [experiments.camera] in lab.toml."),
        ('rig = "drop"\ndrop_height = "25 cm"\ncamera.frame_rate = "240 Hz"', ""),
        (
            'rig = "pendulum"\nvariant = "wall"\nlength = "20 cm"\nrelease_angle = "40 deg"',
            "sweep the rig by itself: rigtwin sweep pendulum --set ...",
        ),
    ],
)
def test_a_twin_that_needs_its_measurement_is_refused_with_what_would_free_it(tmp_path, entries, advice):
    (tmp_path / "r.mp4").write_bytes(b"film")
    text = f'[[experiments]]\nid = "it"\n{entries}\nparticle = "D6"\nwall = "steel"\nrepetitions = ["r.mp4"]\n'
    (tmp_path / "lab.toml").write_text(f'[lab]\ntitle = "one"\n{text}')
    if not advice:
        assert lab_setting(tmp_path, "it")[1].experiment.id == "it"
        return
    with pytest.raises(BadInput, match=f"starts from the measurement; {re.escape(advice)}"):
        lab_setting(tmp_path, "it")


def test_each_setting_that_decides_a_twin_makes_another_run(bed):
    experiment, model = bed
    keys = {twin_run("a", experiment, model, seed=1).key, twin_run("b", experiment, model, seed=1).key}
    assert len(keys) == 1
    for point in (
        {"static_friction": 0.5},
        {"wall_restitution": 0.5},
        {"diameter": 5e-3},
        {"scale": 1.1},
        {"density": 900.0},
        {"youngs_modulus": 1e9},
        {"cylinder_diameter": 0.05},
        {"cohesion_sjkr.energy_density": 1e4},
    ):
        moved = at(bed, point)
        keys.add(twin_run("a", *moved, seed=1).key)
        keys.add(twin_run("a", *moved, seed=2).key)
    assert len(keys) == 17


def test_a_scaled_particle_keeps_its_mass_and_its_shape():
    for name in ("D6", "P6x15"):
        setting = stated_setting("packing", ["cylinder_diameter=65mm", "count=10"], particle=name, wall="PMMA")
        before, after = setting.experiment.particle, at(setting, {"scale": 1.1}).experiment.particle
        assert after.mass == pytest.approx(before.mass)
        assert after.diameter == pytest.approx(1.1 * before.diameter)
        assert after.moments == pytest.approx([1.21 * one for one in before.moments])


def test_another_diameter_keeps_the_ratio_of_the_smallest_particle_to_the_largest(bed):
    bead = bed.experiment.particle
    mixed = sized(bead, uniform(0.7 * bead.diameter, bead.diameter))
    setting = bed._replace(experiment=replace(bed.experiment, particle=mixed))
    for point in ({"diameter": 0.5 * mixed.typical.diameter}, {"scale": 1.2}):
        after = at(setting, point).experiment.particle
        factor = point.get("scale", 0.5)
        assert after.typical.diameter == pytest.approx(factor * mixed.typical.diameter)
        assert after.sizes.smallest == pytest.approx(0.7 * after.diameter)


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("friction=0.1..0.5", "has no parameter 'friction'"),
        ("static_friction", "is not like"),
        ("static_friction=0.5..0.1", "the lower value first"),
        ("static_friction=-1..1", "cannot be -1"),
        ("restitution=0.5..1.5", "cannot be 1.5"),
        ("cylinder_diameter=0.5s,1s", "wrong unit"),
        ("static_friction=0.1..0.5:1", "at least 2"),
        ("cohesion_sjkr.strength=1..2", "has no parameter 'strength'"),
        ("nosuch.strength=1..2", "no effect 'nosuch'"),
    ],
)
def test_an_impossible_parameter_is_named(text, why, bed):
    with pytest.raises(BadInput, match=why):
        parse(text, bed.experiment)


def test_a_grid_has_all_combinations_and_a_space_filling_design_fills_the_ranges(bed):
    varied = [parse(text, bed.experiment) for text in ("static_friction=0.2..1:3", "density=500kg/m^3,900kg/m^3")]
    grid = points(varied, "grid", None, 1)
    assert [tuple(point.values()) for point in grid[:3]] == [(0.2, 500.0), (0.2, 900.0), (0.6, 500.0)]
    assert len(grid) == 6
    ranges = [parse(text, bed.experiment) for text in ("static_friction=0.2..1", "density=500kg/m^3..900kg/m^3")]
    for design in ("sobol", "latin"):
        found = pd.DataFrame(points(ranges, design, 16, 7))
        assert len(found) == 16
        assert found["static_friction"].between(0.2, 1).all()
        assert sorted((found["density"] - 500) // 25) == list(range(16)), design
    with pytest.raises(BadInput, match="needs a range"):
        points(varied, "sobol", 4, 1)
    with pytest.raises(BadInput, match="20000 points; give at most 10000"):
        points(ranges, "sobol", 20000, 1)
    with pytest.raises(BadInput, match="needs their number"):
        points(ranges, "latin", None, 1)


@pytest.mark.parametrize(
    ("rig", "stated", "text", "label", "ticks"),
    [
        ("packing", ["cylinder_diameter=40mm", "count=9"], "cylinder_diameter=30mm,45mm", "cylinder diameter / mm", 45),
        ("packing", ["cylinder_diameter=40mm", "count=9"], "density=500,900", "density / kg/m³", 900),
        ("packing", ["cylinder_diameter=40mm", "count=9"], "count=30,40", "count", 40),
        ("drum", ["drum_diameter=140mm", "speed=3rpm"], "speed=3rpm,6rpm", "speed / rad/s", 0.6283),
        ("packing", ["cylinder_diameter=40mm", "count=9"], "wall_static_friction=0.1,0.2", "wall static friction", 0.2),
        (
            "packing",
            ["cylinder_diameter=40mm", "count=9"],
            "cohesion_sjkr.energy_density=1e3,2e3",
            "cohesion sjkr.energy density / J/m^3",
            2000,
        ),
    ],
)
def test_axes_of_figures_have_units(rig, stated, text, label, ticks):
    experiment = stated_setting(rig, stated, particle="D6", wall="PMMA").experiment
    first, second = parse(text, experiment), parse("static_friction=0.2,0.4", experiment)
    places = points([first, second], "grid", None, 1)
    rows = [{**place, **drawn_row("bed_height", unit="m", simulated=0.02 + k / 1e3)} for k, place in enumerate(places)]
    (heat_map,) = figures([first, second], rows, grid=True).values()
    (panels,) = figures([first, second], rows, grid=False).values()
    for drawing in (heat_map, panels):
        assert f">{label}<" in drawing.svg
        assert ">Bed height, tops / mm<" in drawing.svg
        assert ">static friction<" in drawing.svg
    assert f">{ticks}<" in heat_map.svg


def drawn_row(quantity, method="tops", unit="1", simulated=0.5, **more):
    return {"quantity": quantity, "method": method, "unit": unit, "simulated": simulated, "simulated_std": None, **more}


def test_a_printed_sweep_marks_doubtful_numbers_and_tells_bounces_apart(bed, capsys):
    varied = tuple(parse(f"{name}=0.2,0.4", bed.experiment) for name in ("static_friction", "rolling_friction"))
    rows = [
        {"static_friction": k, "rolling_friction": 0.2, **drawn_row("restitution_wall", "height", **more)}
        for k in (0.2, 0.4)
        for more in (
            {"bounce": 1, "simulated": k, "doubtful": "too few frames" if k == 0.4 else ""},
            {"bounce": 2, "simulated": k + 1, "doubtful": ""},
        )
    ]
    for number in (1, 2):  # a list, and a table of two parameters
        show(Sweep(bed, varied[:number], (), tuple(rows), {}, 2, {"sweep.csv": Path("out/sweep.csv")}), False, False)
        first, second = capsys.readouterr().out.split("restitution_wall, bounce 2 (height)")
        assert first.startswith("restitution_wall, bounce 1 (height) in 1\n")
        assert "0.4 doubtful" in first
        assert "0.2 doubtful" not in first
        assert "doubtful" not in second.split("doubtful: too few frames")[0]


def test_each_figure_has_a_name_of_its_own(bed):
    varied = [parse("static_friction=0.2,0.4", bed.experiment)]
    rows = [
        {"static_friction": 0.2, **row}
        for row in (
            drawn_row("bed_height", "line, 10-90 %"),
            drawn_row("restitution_wall", "height", bounce=1),
            drawn_row("restitution_wall", "height", bounce=2),
            drawn_row("mass_flow", unit="kg/s"),
            drawn_row("mass_flow", unit="1/s"),
            drawn_row("share", "5%"),
            drawn_row("share", "5"),
        )
    ]
    assert list(figures(varied, rows, grid=True)) == [
        "sweep-bed-height-line-10-90",
        "sweep-restitution-wall-height-bounce-1",
        "sweep-restitution-wall-height-bounce-2",
        "sweep-mass-flow-tops-kg-s",
        "sweep-mass-flow-tops-1-s",
        "sweep-share-5-1",
        "sweep-share-5-1-2",
    ]


@pytest.mark.usefixtures("in_this_process")
def test_a_sweep_of_a_rig_writes_a_table_and_a_heat_map_and_runs_nothing_twice(tmp_path, capsys, monkeypatch):
    vary = ["--vary", "static_friction=0.1..0.8:2", "--vary", "rolling_friction=0,0.2"]
    assert run(["sweep", "packing", *BED, *vary, "--out", str(tmp_path)]) == 0
    said = capsys.readouterr().out
    assert "bed_height (surface bead tops) in m" in said
    assert "4 of 4 runs" in said
    table = pd.read_csv(tmp_path / "sweep.csv")
    beds = table[(table["quantity"] == "bed_height") & (table["method"] == "surface bead tops")]
    assert len(beds) == 4
    rough, smooth = beds.loc[beds["static_friction"].idxmax()], beds.loc[beds["static_friction"].idxmin()]
    assert rough["simulated"] > smooth["simulated"]
    assert "<svg" in (tmp_path / "figures" / "sweep-bed-height-surface-bead-tops.svg").read_text()
    monkeypatch.setattr("rigtwin.compare.campaign.runners.spawned", lambda *_: pytest.fail("something was run"))
    assert run(["sweep", "packing", *BED, *vary, "--json", "--out", str(tmp_path)]) == 0
    assert json.loads(capsys.readouterr().out)["runs"] == 4


@pytest.mark.usefixtures("in_this_process")
def test_a_sweep_waits_for_another_that_writes_and_removes_what_a_killed_one_left(tmp_path, capsys, monkeypatch):
    words = ["sweep", "drop", "--set", "drop_height=0.2m", "--vary", "wall_restitution=0.4,0.8", "--out", str(tmp_path)]
    left = tmp_path / "sweep.csv.0a1b2c3d.part"
    with claimed(tmp_path):
        left.write_text("static_fric")
        monkeypatch.setattr("rigtwin.compare.result_files.PATIENCE", 0.1)
        assert run(words) == 2
        assert "another run of rigtwin is writing into it" in capsys.readouterr().err
        assert left.exists()
    assert run(words) == 0
    assert not left.exists()
    assert (tmp_path / "sweep.csv").is_file()


@pytest.mark.usefixtures("in_this_process")
def test_a_sweep_names_the_rows_of_another_that_it_replaces(tmp_path, capsys):
    def said(values):
        words = ["sweep", "drop", "--set", "drop_height=0.2m", "--vary", f"wall_restitution={values}"]
        assert run([*words, "--out", str(tmp_path)]) == 0
        found, replaced = capsys.readouterr().out, "other rows (a sweep of drop over wall_restitution)"
        assert replaced not in found or "give --out another folder to keep both tables" in found
        return replaced in found

    # the third has all rows of the second
    assert [said(values) for values in ("0.4,0.8", "0.4,0.8", "0.4,0.6,0.8", "0.5")] == [False, False, False, True]


@pytest.mark.usefixtures("in_this_process")
def test_values_that_may_be_one_number_with_a_decimal_comma_are_remarked(tmp_path, capsys):
    bed = ["sweep", "packing", *BED, "--out", str(tmp_path / "bed"), "--vary"]
    assert run([*bed, "rolling_friction=0,05"]) == 0
    assert "rolling_friction: 0,05 are two values, 0 and 05; write 0.05 if one is meant" in capsys.readouterr().out


@pytest.mark.usefixtures("in_this_process")
def test_a_sweep_interrupted_after_its_runs_keeps_them_and_says_so(tmp_path, capsys, monkeypatch):
    def stopped(*_args, **_options):
        raise KeyboardInterrupt

    words = ["sweep", "drop", "--set", "drop_height=0.2m", "--vary", "wall_restitution=0.4,0.8", "--out", str(tmp_path)]
    with monkeypatch.context() as patched:
        patched.setattr("rigtwin.compare.campaign.sweep.figures", stopped)
        assert run(words) == 130
    assert f"finished runs are kept in {tmp_path / 'runs'}; the same command" in capsys.readouterr().err
    monkeypatch.setattr("rigtwin.compare.campaign.runners.spawned", lambda *_: pytest.fail("something was run"))
    assert run(words) == 0


@pytest.mark.usefixtures("in_this_process")
def test_a_sweep_of_a_lab_has_the_measured_value_beside_the_twins(tmp_path, capsys):
    lab = tmp_path / "lab"
    lab.mkdir()
    profile = "x_m,height_m\n" + "".join(
        f"{k * 1e-3 - 0.045:.4f},{max(0.0, 0.02 - abs(k - 45) * 4e-4):.5f}\n" for k in range(91)
    )
    for k in (1, 2, 3):
        (lab / f"r{k}.csv").write_text(profile.replace("0.02000", f"0.020{k}0"))
    (lab / "lab.toml").write_text(
        '[[experiments]]\nid = "heap"\nrig = "pile"\nparticle = "D6"\nwall = "steel"\nvariant = "piling"\n'
        'base_diameter = "90 mm"\nrim_height = "10 mm"\ncount = 150\nrepetitions = ["r1.csv", "r2.csv", "r3.csv"]\n'
    )
    assert run(["sweep", str(lab), "--vary", "rolling_friction=0.01,0.3", "--out", str(tmp_path / "out")]) == 0
    table = pd.read_csv(tmp_path / "out" / "sweep.csv")
    assert table["measured"].notna().any()
    known = table[table["measured"].notna() & table["simulated"].notna()]
    deviation = 100 * (known["simulated"] - known["measured"]) / known["measured"]
    assert known["percent_deviation"].to_numpy() == pytest.approx(deviation.to_numpy())
    assert run(["sweep", str(lab), "--only", "bed", "--vary", "count=5,6"]) == 2
    assert "there is no experiment 'bed'" in capsys.readouterr().err


def test_bad_input_is_one_sentence_and_nothing_is_written(tmp_path, capsys):
    out = ["--out", str(tmp_path / "out")]
    for arguments, why in (
        (["sweep", "packing", "--vary", "static_friction=0.1,0.2"], "cylinder_diameter: this setting is missing"),
        (["sweep", "packing", *BED, "--set", "width=3mm", "--vary", "count=5,6"], "has no such setting"),
        (["sweep", "packing", *BED, "--vary", "cylinder_diameter=5mm,40mm"], "there is no twin"),
        (
            ["sweep", "packing", "--set", "cylinder_diametr=4cm", "--vary", "count=5,6"],
            "did you mean 'cylinder_diameter'",
        ),
        (["sweep", "packing", *BED, "--vary", "diameter=6,7"], "diameter 6: the particle would be 6 m wide"),
        (["sweep", "nolab", "--vary", "count=5,6"], "no such file"),
        (
            ["sweep", "packin", *BED, "--vary", "count=5,6"],
            "packin: no such file or folder, and no such rig; did you mean",
        ),
        (["sweep", "packing", *BED, "--vary", "count=5,6", "--cluster", "abc"], "neither the address"),
        (["sweep", "packing", *BED, "--vary", "count=5,6", "--vary", "count=7,8"], "given twice"),
        (
            ["sweep", "packing", *BED, "--vary", "static_friction=0.1,0.2", "--vary", "static_friction@D6-D6=0.3,0.4"],
            "static_friction@D6-D6 and static_friction are the same parameter",
        ),
        (
            ["sweep", "packing", *BED, "--vary", "static_friction=0.1..0.5:101", "--repetitions", "100"],
            "101 points with 100 repetitions are 10100 runs; give fewer of one of them, at most 10000 runs.",
        ),
    ):
        assert run([*arguments, *out]) == 2, why
        assert why in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_the_reference_names_a_particle_of_a_rig():
    setting = stated_setting("drum", ["drum_diameter=140mm", "speed=3rpm"], particle="D6", wall="PMMA")
    assert setting.experiment.particle == hlosta2020.particle("D6")
    assert replace(setting.experiment.rig, speed=1.0) == at(setting, {"speed": 1.0}).experiment.rig
