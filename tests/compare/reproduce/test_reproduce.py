"""Reproduction of the published tables: needed runs, contents of the cells, and kept runs."""

import csv
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rigtwin.benchmarks.reproduce import docs_page as reproduction_page
from rigtwin.cli import run
from rigtwin.compare.campaign.campaign import run_all
from rigtwin.compare.campaign.run import Done, Run
from rigtwin.compare.campaign.store import Store
from rigtwin.compare.reproduce import paper_runs, run_time
from rigtwin.compare.reproduce import reproduce as module
from rigtwin.compare.reproduce.reproduce import Reproduction, drawn_figures, markdown, number, page
from rigtwin.compare.reproduce.studies import READINGS, studies
from rigtwin.compare.reproduce.tables import TABLES, plan
from rigtwin.compare.result_files import plain
from rigtwin.compare.twins import run_cost
from rigtwin.lab.errors import BadInput
from rigtwin.lab.reference import hlosta2020
from rigtwin.sim.engine.contact import ROLLING


def once(made):
    """Made once for the same question."""
    answers = {}

    def asked(*what, **how):
        key = repr((what, how))
        if key not in answers:
            answers[key] = made(*what, **how)
        return answers[key]

    return asked


PLANNED, STUDIED = once(plan), once(studies)


@pytest.fixture(autouse=True)
def the_whole_paper_is_planned_once(monkeypatch):
    """Every page of kept runs asks for all tables under all rolling laws."""
    monkeypatch.setattr(reproduction_page, "plan", PLANNED)
    monkeypatch.setattr(reproduction_page, "studies", STUDIED)


def test_graphical_and_geometric_angles_come_from_the_same_piles():
    both = plan([14, 15], quick=True, repetitions=2, seed=5)
    one = plan([14], quick=True, repetitions=2, seed=5)
    assert {item.name for item in both.runs} == {item.name for item in one.runs}
    assert len(both.cells) == 2 * len(one.cells)
    assert len({item.name for item in one.runs}) == len(one.runs) == 2 * len(one.cells)


@pytest.mark.parametrize("table", TABLES)
def test_every_cell_has_the_value_of_the_paper(table):
    whole = plan([table], quick=False, repetitions=None, seed=1)
    printed = {value for row in hlosta2020.table(table) for value in row.values()}
    names = {item.name for item in whole.runs}
    for cell in whole.cells:
        assert cell.experiment is None or cell.experiment in printed
        assert cell.paper_dem is None or cell.paper_dem in printed
        assert set(cell.runs) <= names


def test_a_table_that_is_not_reproduced_is_named(capsys, tmp_path):
    assert run(["reproduce", "hlosta2020", "--table", "3", "--out", str(tmp_path / "out")]) == 2
    assert "table 3 is not reproduced" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("wrong", [["--table", "99"], ["--study", "colour"]])
def test_an_unknown_table_or_study_is_named_also_without_kept_runs(wrong, capsys, tmp_path):
    assert run(["reproduce", "hlosta2020", "--kept", *wrong, "--out", str(tmp_path)]) == 2
    assert wrong[1] in capsys.readouterr().err


def keep(folder: Path, table: int, *, result=None, warnings=(), **plan_of):
    """Finished runs of a table's quick part, without running them."""
    found = result or {"discharge_time_s": 1.0, "graphical_deg": 20.0}
    runs = plan([table], **{"quick": True, "repetitions": None, "seed": 1, **plan_of}).runs
    stored(folder, *((one, {"warnings": list(warnings), **found}) for one in runs))


def stored(folder: Path, *kept):
    """Runs with their results in the store of a folder."""
    with Store(folder / "runs") as store:
        for one, result in kept:
            store.keep(one, result, 1.0)


@pytest.fixture
def filled(monkeypatch):
    """Runs that give the paper's own DEM values for the first cell and half of it for the others."""

    def pretend(runs, folder, **_):
        cells = plan([14], quick=True, repetitions=2, seed=1).cells
        first, *others = cells
        results = {name: {"graphical_deg": first.paper_dem + k - 0.5} for k, name in enumerate(first.runs)}
        for cell in others[:-1]:
            results.update({name: {"graphical_deg": cell.paper_dem / 2} for name in cell.runs})
        return Done(results, {others[-1].runs[0]: "the heap fell over."})

    monkeypatch.setattr(module, "run_all", pretend)


def test_ours_stands_beside_the_paper(filled, tmp_path, capsys):
    assert (
        run(["reproduce", "hlosta2020", "--table", "14", "--quick", "--repetitions", "2", "--out", str(tmp_path)]) == 0
    )
    assert "the heap fell over" in capsys.readouterr().out
    with (tmp_path / "cells.csv").open() as file:
        first, *others = csv.DictReader(file)
    assert float(first["ours"]) == pytest.approx(float(first["paper_dem"]))
    assert float(first["ours_std"]) == pytest.approx(0.5**0.5)
    assert first["ours_percent_deviation"] == first["paper_dem_percent_deviation"]
    assert float(others[0]["ours_against_paper_dem_percent"]) == pytest.approx(-50)
    assert others[-1]["ours"] == ""
    (score,) = json.loads((tmp_path / "cells.json").read_text())["scores"]
    assert score["done"] == score["cells"] - 1
    assert score["no_further"] >= 1
    html = (tmp_path / "report.html").read_text()
    assert html.count("<tr>") == score["cells"] + 1
    assert "without a rim no pile forms" in html
    assert "type A" in first["rolling_model"]
    assert "own spin, R from the contact to its centre of mass (type A)" in html


def planned_but_first(**other):
    """The plan, with another first run."""

    def planned(*asked, **options):
        found = plan(*asked, **options)
        first, *others = found.runs
        return replace(found, runs=(replace(first, **other), *others))

    return planned


def test_a_fault_in_one_run_leaves_the_others_shown_and_the_command_ends_with_1(tmp_path, monkeypatch, capsys):
    keep(tmp_path, 16)
    monkeypatch.setattr(module, "plan", planned_but_first(function="operator:truediv"))
    asked = ["reproduce", "hlosta2020", "--table", "16", "--quick", "--out", str(tmp_path)]
    assert run(asked) == 1
    printed = capsys.readouterr()
    assert "failed type_A-slot_hopper-D12-seed1: a fault of rigtwin itself (TypeError: " in printed.out
    assert printed.err.startswith(
        "rigtwin: 1 of 3 runs failed, type_A-slot_hopper-D12-seed1 by a fault of rigtwin itself ("
    )
    assert "Traceback" not in printed.err
    assert run([*asked, "--json"]) == 1
    document = json.loads(capsys.readouterr().out)
    assert sum(row["ours"] is not None for row in document["cells"]) == 2
    assert document["faults"] == ["type_A-slot_hopper-D12-seed1"]
    assert "a fault of rigtwin itself" in (tmp_path / "reproduction.md").read_text()
    monkeypatch.setenv("RIGTWIN_DEBUG", "1")
    assert run([*asked, "--quiet"]) == 1
    assert "Traceback" in capsys.readouterr().err


def test_a_run_out_of_memory_leaves_the_others_shown_and_the_command_ends_with_2(tmp_path, monkeypatch, capsys):
    keep(tmp_path, 16)
    huge = planned_but_first(function="builtins:bytearray", settings={"source": 2**60})
    monkeypatch.setattr(module, "plan", huge)
    asked = ["reproduce", "hlosta2020", "--table", "16", "--quick", "--out", str(tmp_path)]
    assert run(asked) == 2
    printed = capsys.readouterr()
    assert "failed type_A-slot_hopper-D12-seed1: does not fit into memory" in printed.out
    assert printed.err.startswith(
        "rigtwin: 1 of 3 runs failed, the first being type_A-slot_hopper-D12-seed1, which does not"
    )
    assert "give fewer --workers" in printed.err
    assert run([*asked, "--json"]) == 2
    document = json.loads(capsys.readouterr().out)
    assert sum(row["ours"] is not None for row in document["cells"]) == 2
    assert document["out_of_memory"] == ["type_A-slot_hopper-D12-seed1"]
    assert document["faults"] == []


def test_a_page_without_any_result_can_be_written(tmp_path):
    cells = plan(None, quick=True, repetitions=None, seed=1).cells
    empty = Reproduction(cells, Done({}, {}), tmp_path)
    assert "0 of" in page(empty, drawn_figures(empty))
    assert all(row["ours"] is None for row in empty.rows)


def test_the_digits_of_a_number_follow_from_its_scatter():
    assert number(184.0, 1.3) == "184.0 ± 1.3"
    assert number(2.716) == "2.72"


def test_a_swept_bed_is_judged_by_its_absolute_deviation(tmp_path):
    cells = plan([4], quick=False, repetitions=None, seed=1).cells
    assert len(cells) == 56
    # beds with the absolute deviations of the paper, some too low
    results = {
        cell.runs[0]: {"bead_tops_height_mm": 184.0 * (1 + (-1) ** k * cell.paper_dem / 100)}
        for k, cell in enumerate(cells[:20])
    }
    swept = Reproduction(cells, Done(results, {}), tmp_path)
    (score,) = swept.scores
    assert (score["done"], score["judged"]) == (20, 0)
    assert score["rank_correlation"] == pytest.approx(1.0, abs=0.01)  # ties are split by rounding
    assert score["mean_difference"] == pytest.approx(0.0, abs=1e-9)
    assert swept.rows[0]["ours"] == pytest.approx(swept.rows[0]["paper_dem"])
    assert swept.rows[0]["ours_against_paper_dem_percent"] is None  # of a deviation
    text = markdown(swept)
    assert "20 of 56 cells run; rank correlation with the paper's simulation 1.00" in text
    assert text.count("| D6, static friction") == 20


def test_table_7_has_rows_with_the_first_frictions_that_are_not_judged(tmp_path):
    planned = plan([7], quick=False, repetitions=None, seed=1).cells
    cells = [cell for cell in planned if cell.quantity == "bed_height"]
    first = [cell for cell in cells if "before calibration" in cell.row]
    assert [cell.paper_dem for cell in first] == [cell.paper_dem for cell in cells if cell not in first]
    assert all(cell.experiment is None for cell in first)
    results = {name: {"bead_tops_height_mm": 1.1 * cell.paper_dem} for cell in first for name in cell.runs}
    table = Reproduction(cells, Done(results, {}), tmp_path)
    (score,) = table.scores
    assert (score["done"], score["judged"]) == (14, 0)
    assert markdown(table).count("| +10.0 |") == 14


def test_table_7_has_computing_times_without_a_deviation(tmp_path, capsys):
    keep(tmp_path, 7, result={"bead_tops_height_mm": 200.0, "seconds_per_particle": 0.0125})
    asked = ["reproduce", "hlosta2020", "--table", "7", "--quick", "--kept", "--out", str(tmp_path)]
    assert run([*asked, "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    rows = {row["row"]: row for row in document["cells"] if row["quantity"] == "seconds_per_particle"}
    assert {name: row["paper_dem"] for name, row in rows.items()} == {"D6": 1.99, "D12": 2.94, "D6_ABS": 1.96}
    assert {(row["ours"], row["unit"]) for row in rows.values()} == {(0.0125, "s")}
    deviations = {value for row in rows.values() for name, value in row.items() if "percent" in name}
    assert deviations == {None}
    (score,) = document["scores"]
    assert (score["done"], score["judged"]) == (6, 3)
    assert "processor time of one thread" in document["assumptions"]["computing"]
    assert "Computing time per particle" in (tmp_path / "report.html").read_text()
    assert (
        "| D12 | Computing time per particle, s | – | 2.94 | 0.0125 | 1 | – |"
        in (tmp_path / "reproduction.md").read_text()
    )
    # of all virtual particles, where the whole table is asked for
    every = plan([7], quick=False, repetitions=1, seed=1).cells
    assert len([cell for cell in every if cell.quantity == "seconds_per_particle"]) == 28


def flowed(folder: Path, **result):
    """The rows of table 13 at 1e6 Pa by quantity, of a run that gave this."""
    keep(folder, 13, result={"rayleigh_step_s": 2.45e-4, "asked": 15000, **result})
    assert run(["reproduce", "hlosta2020", "--table", "13", "--quick", "--kept", "--quiet", "--out", str(folder)]) == 0
    return {row["quantity"]: row for row in json.loads((folder / "cells.json").read_text())["cells"]}


def test_flows_are_not_compared_with_the_paper_where_all_particles_left(
    tmp_path,
):
    rows = flowed(tmp_path, emptied=15000, mass_flow_g_s=213.0, steady_mass_flow_g_s=331.8)
    assert {name: (row["paper_dem"], row["ours"]) for name, row in rows.items()} == {
        "emptied_particles": (12223, 15000),
        "mass_flow": (173.6, 213.0),
        "steady_mass_flow": (173.6, 331.8),
        "rayleigh_time_step": (2.45e-4, 2.45e-4),
    }
    against = {name: row["ours_against_paper_dem_percent"] for name, row in rows.items()}
    assert [name for name, percent in against.items() if percent is not None] == ["rayleigh_time_step"]
    assert [name for name, row in rows.items() if row["doubtful"]] == ["emptied_particles", "mass_flow"]
    assert rows["mass_flow"]["doubtful"].startswith("all had left before the end of the time")
    assert "Mass flow rate, steady, g/s" in (tmp_path / "report.html").read_text()


def test_flows_are_compared_with_the_paper_where_particles_remain(tmp_path):
    said = ["only 11000 of 15000 beads had left the hopper when the run ended"]
    rows = flowed(tmp_path, emptied=11000, mass_flow_g_s=156.24, steady_mass_flow_g_s=None, warnings=said)
    assert rows["mass_flow"]["ours_against_paper_dem_percent"] == pytest.approx(-10.0)
    assert rows["emptied_particles"]["ours_against_paper_dem_percent"] == pytest.approx(-10.0, abs=0.01)
    assert rows["steady_mass_flow"]["ours"] is None
    assert not any(row["doubtful"] for row in rows.values())


@pytest.mark.parametrize(("particle", "frictions"), [("D6", (0.2, 0.01)), ("C6_24s", (0.5, 0.1))])
def test_the_twin_of_table_7_has_the_printed_parameters(particle, frictions, monkeypatch):
    from rigtwin.compare.twins import packing

    class Asked(Exception):
        pass

    def twin(_rig, cast, **_):
        raise Asked(cast)

    monkeypatch.setattr(packing, "packing_twin", twin)
    runs = {run.name: run for run in plan([7], quick=False, repetitions=1, seed=1).runs}
    with pytest.raises(Asked) as asked:
        paper_runs.packing(**runs[f"type_A-packing-{particle}-before-seed1"].settings)
    cast = asked.value.args[0]
    assert cast.particle == hlosta2020.particle(particle, enlarged=False)
    assert (cast.contact.static_friction, cast.contact.rolling_friction) == frictions
    assert cast.wall_contact == hlosta2020.contact(particle, "PMMA")


def test_a_bed_that_spills_is_poured_again_into_a_higher_cylinder(monkeypatch):
    from rigtwin.compare.twins import packing

    low = 27e-3  # [m]; 60 beads stand some 30 mm high in 25 mm

    def cylinder(height):
        monkeypatch.setattr(packing, "cylinder_for", lambda rig, *_: replace(rig, cylinder_height=height))
        return paper_runs.packing("D6", count=60, seed=1, cylinder=25e-3)

    again, high = cylinder(low), cylinder(paper_runs.HIGHER * low)
    assert high["missed"] == 0
    assert {**again, "seconds_per_particle": 0, "wall_s": 0} == {**high, "seconds_per_particle": 0, "wall_s": 0}
    assert high["cylinder_height_mm"] == pytest.approx(40.5)


def test_a_repeated_experiment_is_as_often_that_near_as_random_runs():
    """Ten runs, their mean and standard deviation, and further runs, all drawn from one normal distribution."""
    random = np.random.default_rng(3)
    for runs in (1, 10):
        first, more = random.normal(size=(40_000, 10)), random.normal(size=(40_000, runs)).mean(1)
        std = first.std(axis=1, ddof=1)
        drawn = float(np.mean(np.abs(more - first.mean(1)) <= 0.7 * std))
        row = {"paper_dem": 20.7, "paper_experiment": 20.0, "paper_experiment_std": 1.0}
        without = {"paper_dem": 1.0, "paper_experiment": 2.0, "paper_experiment_std": None}
        assert reproduction_page.repeated([row, without], runs) == pytest.approx(drawn, abs=0.01)
    assert reproduction_page.repeated([without], 1) is None


def test_studies_share_their_piles_with_the_tables():
    runs, found = studies(["evaluation"], seed=1)
    assert len(found) == 1
    tabled = {run.key for run in plan([14], quick=False, repetitions=3, seed=1).runs}
    assert {run.key for run in runs} <= tabled
    with pytest.raises(BadInput, match="no study 'colour'"):
        studies(["colour"], seed=1)


@pytest.mark.parametrize("number", TABLES)
def test_every_cell_is_run_as_often_as_asked(number):
    for cell in plan([number], quick=False, repetitions=2, seed=4).cells:
        assert [name.rpartition("seed")[2] for name in cell.runs] == ["4", "5"]


def test_every_point_of_a_study_is_run_as_often_as_asked():
    _, found = studies(None, repetitions=2, seed=4)
    for study in found:
        assert all([name[-5:] for name in names] == ["seed4", "seed5"] for names in study.places.values())


def test_a_study_shows_mean_and_scatter_of_the_piles_that_are_there(tmp_path):
    runs, found = studies(["number"], seed=1)
    (study,) = found
    first, *others = study.places
    angles = iter((20.0, 24.0, 31.0))
    some = [*study.places[first], study.places[others[0]][0]]
    results = {name: {"graphical_line_15_85_deg": angle} for name, angle in zip(some[:3], angles, strict=True)}
    points = study.points(results)
    assert points == {"graphical, 15-85 %": [(first, 25.0, pytest.approx(5.568, abs=1e-3), 3)]}
    shown = Reproduction((), Done(results, {}), tmp_path, tuple(found))
    assert "25.0 ± 5.6 (3)" in markdown(shown)
    assert "<svg" in page(shown, drawn_figures(shown))
    assert len(runs) == len({run.key for run in runs}) == 15


def keep_heaps(folder: Path, study: str, angles, places=None):
    """One finished pile for each point of a study, or for its first `places` alone."""
    heaps, _ = studies([study], seed=1, quick=True)
    read = [{"warnings": [], **dict.fromkeys(READINGS.values(), angle)} for angle in angles]
    stored(folder, *zip(heaps[:places], read, strict=False))


def test_a_study_is_shown_in_the_terminal_and_kept_in_a_table_of_its_own(tmp_path, capsys):
    keep_heaps(tmp_path, "base", (31.0, 32.0, 33.0, 34.0, 35.0))
    assert run(["reproduce", "hlosta2020", "--study", "base", "--quick", "--kept", "--out", str(tmp_path)]) == 0
    printed = capsys.readouterr().out
    assert "Base over particle size: D6" in printed
    shown = [[cell.strip() for cell in line.strip("│").split("│")] for line in printed.splitlines() if "apex" in line]
    assert shown == [
        [ratio, "geometric, apex", angle, "1"]
        for ratio, angle in (("6", "31"), ("10", "32"), ("15", "33"), ("20", "34"), ("25", "35"))
    ]
    assert f"wrote {tmp_path / 'studies.csv'}" in printed
    assert "missing" not in printed
    with (tmp_path / "studies.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert list(rows[0]) == ["study", "rolling_model", "reading", "place", "unit", "mean", "std", "runs"]
    assert len(rows) == 5 * 3
    assert [row["mean"] for row in rows if row["reading"] == "geometric, apex"] == ["31", "32", "33", "34", "35"]
    assert {(row["study"], row["rolling_model"], row["std"], row["runs"]) for row in rows} == {
        ("base", "type A", "", "1")
    }


def test_a_study_that_is_not_kept_is_said_to_be_missing(tmp_path, capsys):
    keep_heaps(tmp_path, "base", (31.0, 32.0), 2)
    asked = ["reproduce", "hlosta2020", "--study", "base", "--study", "number", "--quick", "--kept"]
    assert run([*asked, "--out", str(tmp_path)]) == 0
    printed = capsys.readouterr().out
    assert "missing: study base, type A: lacks 3 of 5 runs; leave --kept out to run them\n" in printed
    assert "missing: study number, type A: lacks 5 of 5 runs; leave --kept out to run them\n" in printed
    assert "Number of particles" not in printed
    assert run([*asked, "--json", "--out", str(tmp_path)]) == 0
    assert len(json.loads(capsys.readouterr().out)["missing"]) == 2


def test_kept_results_are_shown_without_running_anything(tmp_path, monkeypatch):
    from rigtwin.compare.campaign import runners as queue

    monkeypatch.setattr(queue, "spawned", lambda *_: pytest.fail("something was run"))
    keep(tmp_path, 16)
    assert run(["reproduce", "hlosta2020", "--table", "16", "--kept", "--quiet", "--out", str(tmp_path)]) == 0
    assert "Table 16" in (tmp_path / "report.html").read_text()


def test_without_kept_runs_an_error_is_given_and_nothing_is_written(tmp_path, capsys):
    asked = ["reproduce", "hlosta2020", "--table", "16", "--kept", "--out"]
    assert run([*asked, str(tmp_path / "nosuch")]) == 2
    assert "no finished run" in capsys.readouterr().err
    assert not (tmp_path / "nosuch").exists()
    keep(tmp_path, 16)
    assert run([*asked, str(tmp_path)]) == 0
    before = (tmp_path / "cells.csv").read_text()
    for other in (["--seed", "2"], ["--rolling-model", "C"]):
        assert run([*asked, str(tmp_path), *other]) == 2
    assert (tmp_path / "cells.csv").read_text() == before


def test_a_remark_names_earlier_cells_that_are_not_requested_again(tmp_path, capsys):
    for table in (14, 16):
        keep(tmp_path, table)
    asked = ["reproduce", "hlosta2020", "--quick", "--kept", "--out", str(tmp_path)]
    assert run([*asked, "--table", "14", "--table", "16"]) == 0
    assert "replaced" not in capsys.readouterr().out
    assert run([*asked, "--table", "16", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["replaced"].startswith("4 finished cells or points (table 14, type A)")
    assert run([*asked, "--table", "16"]) == 0
    assert "replaced" not in capsys.readouterr().out


def test_each_kind_of_warning_of_the_runs_is_shown_once(tmp_path, capsys):
    keep(tmp_path, 16, warnings=["impacts pressed beads up to 9.2% of a radius; do something"])
    (one, *_) = (run for run in plan([16], quick=True, repetitions=None, seed=1).runs if "D12" in run.name)
    worst = "impacts pressed beads up to 12.5% of a radius; do something"
    stored(tmp_path, (one, {"discharge_time_s": 1.0, "graphical_deg": 20.0, "warnings": [worst]}))
    assert run(["reproduce", "hlosta2020", "--table", "16", "--quick", "--kept", "--out", str(tmp_path)]) == 0
    said = "in 3 of 3 runs: impacts pressed beads up to 12.5% of a radius"
    assert f"warning: {said}\n" in capsys.readouterr().out
    for name in ("report.html", "reproduction.md"):
        text = (tmp_path / name).read_text()
        assert text.count(said) == text.count("impacts pressed") == 1


def test_the_worst_of_hoppers_that_did_not_empty_is_the_one_that_kept_most(tmp_path, capsys):
    keep(tmp_path, 16)
    runs = plan([16], quick=True, repetitions=None, seed=1).runs
    for one, share in zip(runs, ("2951 of 2984", "60 of 630"), strict=False):
        said = f"only {share} beads had left the hopper when the run ended"
        stored(tmp_path, (one, {"warnings": [said]}))
    assert run(["reproduce", "hlosta2020", "--table", "16", "--quick", "--kept", "--out", str(tmp_path)]) == 0
    assert "warning: in 2 of 3 runs: only 60 of 630 beads had left" in capsys.readouterr().out


SPOILT = {
    "the bed was still moving when the time limit was reached": {
        "at_rest": False,
        "warnings": ["the bed was still moving when the time limit was reached"],
    },
    "it was still moving at the end": {"at_rest": False},
    "4 of 2000 particles did not stay in the cylinder": {"at_rest": True, "missed": 4, "placed": 2000},
    "7 of 2000 particles did not stay in the cylinder": {
        "missed": 7,
        "warnings": ["7 of 2000 particles did not stay in the cylinder"],
    },
    "only 40 of 50 particles found room below the outlet": {
        "warnings": ["only 40 of 50 particles found room below the outlet"],
    },
    "": {
        "at_rest": True,
        "missed": 0,
        "fallen": 39,
        "warnings": ["impacts pressed beads up to 9.2% of a radius together (otherwise 1.9%); do something"],
    },
}


@pytest.mark.parametrize("why", SPOILT)
def test_a_cell_whose_run_moved_or_lost_particles_is_marked_wherever_it_is_shown(why, tmp_path, capsys):
    keep(tmp_path, 4, result={"bead_tops_height_mm": 190.0, **SPOILT[why]})
    assert run(["reproduce", "hlosta2020", "--table", "4", "--quick", "--kept", "--out", str(tmp_path)]) == 0
    printed = capsys.readouterr().out
    with (tmp_path / "cells.csv").open() as file:
        assert [row["doubtful"] for row in csv.DictReader(file)] == [why] * 4
    document = json.loads((tmp_path / "cells.json").read_text())
    assert [row["doubtful"] for row in document["cells"]] == [why] * 4
    (score,) = document["scores"]
    assert (score["doubtful"], score["rank_correlation"]) == (4 if why else 0, None)  # equal values have no ranks
    assert ("4 doubtful" in (tmp_path / "reproduction.md").read_text()) == bool(why)
    assert (tmp_path / "reproduction.md").read_text().count(f"| {why} |\n") >= 4
    assert (tmp_path / "report.html").read_text().count(f">{why}</td>") >= 4
    assert printed.count("doubtful: D6, static friction") == (4 if why else 0)
    assert why in printed


def test_a_cell_of_several_runs_says_in_how_many_and_stays_when_none_of_them_emptied(tmp_path):
    left = {"warnings": ["only 1960 of 2000 beads had left the hopper when the run ended"]}
    first, second, *_ = plan([16], quick=True, repetitions=3, seed=1).cells
    found = {name: {"discharge_time_s": 1.0} for name in first.runs[1:]} | {first.runs[0]: left}
    found |= dict.fromkeys(second.runs, left)
    one, none = Reproduction((first, second), Done(found, {}), tmp_path).rows
    words = "only 1960 of 2000 beads had left the hopper when the run ended"
    assert (one["runs"], one["doubtful"]) == (2, f"{words} (1 of 3 runs)")
    assert (none["ours"], none["doubtful"]) == (None, f"{words} (3 of 3 runs)")
    text = markdown(Reproduction((second,), Done(found, {}), tmp_path))
    assert f" | – | {words} (3 of 3 runs) |\n" in text


def test_cells_written_without_doubtful_values_are_read_unchanged(tmp_path):
    (one, *_) = plan([16], quick=True, repetitions=1, seed=1, rolling="type C").runs
    moved = {"discharge_time_s": 1.0, "warnings": ["the bed was still moving when the outlet was opened; wait"]}
    stored(tmp_path, (one, moved))
    columns = [name for name in module.COLUMNS if name != "doubtful"]
    old = dict.fromkeys(columns, "") | {"table": 16, "row": "D6", "quantity": "discharge_time", "unit": "s"}
    with (tmp_path / "cells.csv").open("w") as file:
        writer = csv.DictWriter(file, columns)
        writer.writeheader()
        writer.writerow({**old, "rolling_model": "type C", "ours": 2.88, "runs": 1})
    shown = reproduction_page.kept(tmp_path / "runs", reproduction_page.run_before(tmp_path / "cells.csv"))
    doubtful = {row["row"]: row["doubtful"] for row in shown.rows if row["ours"] is not None}
    assert doubtful == {"D6": "", "D12": "the bed was still moving when the outlet was opened"}
    assert "1 doubtful" in markdown(shown)


@pytest.mark.parametrize(
    ("table", "name", "place", "other"),
    [
        (7, "D6", ("particle", "diameter"), 0.0064),
        (7, "D6", ("contact", "static_friction"), 0.9),
        (16, "P6x15", ("particle", "spheres", 0, 1), 0.002),
        (16, "P6x15", ("rig", "slot_length"), 0.075),
        (14, "D6", ("wall", "youngs_modulus"), 1e9),
    ],
)
def test_a_kept_run_of_another_particle_contact_or_rig_is_not_used(table, name, place, other, tmp_path):
    one = next(item for item in plan([table], quick=True, repetitions=1, seed=1).runs if f"-{name}-" in item.name)
    result = {"discharge_time_s": 1.0, "bead_tops_height_mm": 200.0, "graphical_deg": 20.0}

    def read(inputs):
        stored(tmp_path, (replace(one, inputs=inputs), result))
        shown = reproduction_page.kept(tmp_path / "runs", {})
        found = run_all([one], tmp_path / "runs", only_kept=True).results
        assert (one.name in found) == (one.name in shown.done.results)
        return one.name in found

    inputs = json.loads(json.dumps(plain(one.inputs)))
    assert read(inputs)
    *way, last = place
    inner = inputs
    for step in way:
        inner = inner[step]
    inner[last] *= 1 + 1e-9  # rounding differs between machines
    assert read(inputs)
    inner[last] = other
    assert not read(inputs)
    assert read({})  # a run that states no inputs


def test_a_new_run_keeps_its_inputs(tmp_path):
    one = Run("one", "builtins:dict", {"number": 16}, inputs={"diameter": 6e-3})
    run_all([one], tmp_path)
    other = replace(one, inputs={"diameter": 12e-3})
    assert other.key == one.key
    assert run_all([one], tmp_path, only_kept=True).results
    assert not run_all([other], tmp_path, only_kept=True).results
    assert run_all([other], tmp_path).results
    assert not run_all([one], tmp_path, only_kept=True).results


def test_a_run_costs_as_its_spheres_and_steps_and_the_quick_part_takes_minutes():
    bed, twice = run_time.of_bed("D6", 1500), run_time.of_bed("D6", 3000)
    assert twice - run_cost.START == pytest.approx(2 * (bed - run_cost.START))
    stiff, soft = run_time.of_flow(5000, 1e8), run_time.of_flow(5000, 1e6)
    assert stiff - run_cost.START == pytest.approx(10 * (soft - run_cost.START))
    assert run_time.of_pile("C6", 0.15) > 5 * run_time.of_pile("P6x15", 0.15)
    quick = plan(None, quick=True, repetitions=None, seed=1).runs
    assert sum(run.cost for run in quick) / 2 < 600  # two cores
    assert any("drum" in run.name for run in quick)


@pytest.mark.parametrize("table", [number for number in TABLES if number != 5])
def test_the_quick_part_of_a_table_is_some_of_its_cells_in_a_few_minutes(table):
    quick, whole = (plan([table], quick=short, repetitions=1, seed=1) for short in (True, False))
    assert 0 < len(quick.cells) < len(whole.cells)
    assert set(quick.cells) < set(whole.cells)
    assert sum(run.cost for run in quick.runs) / 2 < 200  # [s] on two cores


@pytest.mark.parametrize("others", [[], ["--table", "4"], ["--kept"]])
def test_a_table_without_a_quick_part_is_refused_before_anything_is_written(others, tmp_path, capsys):
    keep(tmp_path, 16)
    assert run(["reproduce", "hlosta2020", "--quick", "--table", "5", *others, "--out", str(tmp_path)]) == 2
    assert "table 5 has no quick part" in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["runs"]
    assert 5 not in {cell.table for cell in plan(None, quick=True, repetitions=None, seed=1).cells}


def test_a_quick_study_has_one_pile_for_each_point_unless_repetitions_are_given(tmp_path, monkeypatch):
    asked = []
    monkeypatch.setattr(module, "run_all", lambda runs, *_, **__: asked.append(list(runs)) or Done({}, {}))
    for more, heaps in (["--quick"], 5), (["--quick", "--repetitions", "2"], 10), ([], 15):
        assert run(["reproduce", "hlosta2020", "--study", "number", *more, "--quiet", "--out", str(tmp_path)]) == 0
        assert len(asked.pop()) == heaps


def test_progress_counts_the_cost_of_what_is_done(tmp_path):
    runs = [
        Run(name, "builtins:dict", {"cost": run_time}, run_time) for name, run_time in (("dear", 30.0), ("cheap", 10.0))
    ]
    run_all(runs[1:], tmp_path)
    seen = []
    run_all(runs, tmp_path, progress=lambda _stage, done, whole: seen.append((done, whole)))
    assert seen == [(10.0, 40.0), (40.0, 40.0)]


def test_each_rolling_law_has_its_own_runs_and_type_c_uses_earlier_ones():
    by_law = {law: plan(None, quick=False, repetitions=1, seed=1, rolling=law) for law in ROLLING}
    by_default = plan(None, quick=False, repetitions=1, seed=1)
    assert by_default == by_law["type A"]
    for law, planned in by_law.items():
        assert {cell.rolling for cell in planned.cells} == {law}
        assert {name for cell in planned.cells for name in cell.runs} == {item.name for item in planned.runs}
    assert all(item.settings["rolling"] == "type A" for item in by_law["type A"].runs)
    # names and settings from before there was a choice, so that runs kept then are found
    before = {item.name: item.settings for item in by_law["type C"].runs}
    assert before["slot_hopper-D12-seed1"] == {"particle": "D12", "seed": 1, "count": 630, "outlet": 0.05}
    assert not {item.name for item in by_law["type A"].runs} & set(before)


@pytest.mark.parametrize("law", ROLLING)
def test_the_twin_rolls_by_the_law_that_the_table_names(law, monkeypatch):
    class Asked(Exception):
        pass

    def twin(*_, rolling, **__):
        raise Asked(rolling)

    for rig in ("pile", "packing", "drum", "hopper"):
        monkeypatch.setattr(f"rigtwin.compare.twins.{rig}.{rig}_twin", twin)
    runs, _ = studies(None, repetitions=1, seed=1, rolling=law)
    for item in (*plan(None, quick=True, repetitions=1, seed=1, rolling=law).runs, *runs[:1]):
        with pytest.raises(Asked, match=law):
            getattr(paper_runs, item.function.partition(":")[2])(**item.settings)


def test_the_law_of_the_tables_is_an_option(tmp_path, capsys):
    said = {"A-explicit": "type A explicit", "C": "type C"}
    for law in ROLLING:
        keep(tmp_path, 16, rolling=law)
    for option, law in (([], "type A"), *((["--rolling-model", name], law) for name, law in said.items())):
        asked = ["reproduce", "hlosta2020", "--table", "16", "--kept", *option, "--json", "--out", str(tmp_path)]
        assert run(asked) == 0
        document = json.loads(capsys.readouterr().out)
        assert {cell["rolling_model"] for cell in document["cells"]} == {law}
        assert {score["rolling_model"] for score in document["scores"]} == {law}
        assert law in document["assumptions"]["rolling"]


def test_runs_and_cells_that_name_no_law_are_read_as_type_c(tmp_path):
    kept = {"rolling": "type A", "seconds": 1.0}, {"seconds": 2.0}
    for k, one in enumerate(kept):
        settings = {"particle": "D12", "seed": 1, "count": 630, "outlet": 0.05}
        law = {"rolling": one["rolling"]} if "rolling" in one else {}
        run = Run(str(k), "rigtwin.compare.reproduce.paper_runs:slot_hopper", settings | law)
        stored(tmp_path, (run, {"discharge_time_s": one["seconds"]}))
    cells = tmp_path / "cells.csv"
    cells.write_text(
        "table,row,quantity,unit,paper_experiment,paper_experiment_std,paper_dem,paper_dem_std,ours,ours_std,runs,"
        "paper_dem_percent_deviation,ours_percent_deviation,ours_against_paper_dem_percent\n"
        "16,D6,discharge_time,s,2.72,,2.71,,2.88,,1,-0.37,6.1,6.5\n"
    )
    page_of_both = reproduction_page.kept(tmp_path / "runs", reproduction_page.run_before(cells))
    ours = {(row["row"], row["rolling_model"]): row["ours"] for row in page_of_both.rows if row["table"] == 16}
    assert (ours["D12", "type A"], ours["D12", "type C"]) == (1.0, 2.0)
    assert (ours["D6", "type A"], ours["D6", "type C"]) == (None, 2.88)
    text = markdown(page_of_both)
    assert text.count("## Table 16, rolling type ") == 2
    assert "1 of 7 cells run" in text.partition("## Table 16, rolling type A")[2][:40]
    assert "2 of 7 cells run" in text.partition("## Table 16, rolling type C")[2][:40]
    said = reproduction_page.summary(page_of_both)
    assert "type A: 1 of 63 cells run" in said
    assert "type A, the 1 cells run under all laws" in said


def test_a_study_run_before_stays_on_the_page_of_a_folder_without_it(tmp_path):
    before, text = tmp_path / "studies.csv", "\n## What the runs warn of\n\n- in 9 of 30 runs: the bed sank by 7 mm\n"
    before.write_text(
        "study,rolling_model,reading,place,unit,mean,std,runs\n"
        'base,type A,"geometric, apex",6,deg,36.2,3.8,3\n'
        'base,type A,"geometric, apex",10,deg,36.9,,1\n'
        'evaluation,type C,"geometric, apex, above the rim",90 mm,deg,33.9,0.9,3\n'
    )
    heaps, _ = studies(["base"], seed=1, quick=True)
    for one, angle in zip(heaps[:2], (50.0, 40.0), strict=True):
        found = {"geometric_apex_deg": angle, "warnings": ["the bed sank by 4 mm; wait", "it hums; wait"]}
        stored(tmp_path, (one, found))

    known = reproduction_page.points_run_before(before), reproduction_page.said_before(text)
    shown = reproduction_page.kept(tmp_path / "runs", {}, *known)
    written = markdown(shown)
    assert "| 6 | 36.2 ± 3.8 (3) |\n" in written, "three heaps of before count more than a single one"
    assert "| 10 | 40 (1) |\n" in written, "of as many the new one counts"
    assert "| 90 mm | 33.9 ± 0.9 (3) |\n" in written
    assert len(shown.study_rows) == 3
    warned = written.partition("## What the runs warn of\n\n")[2].splitlines()
    assert warned == ["- the bed sank by 7 mm", "- it hums"]


def test_the_table_of_studies_holds_what_the_page_shows(tmp_path):
    docs = Path(__file__).parents[3] / "docs"
    known = reproduction_page.points_run_before(docs / "reproduction_studies.csv")

    def of_studies(text):
        return text.partition("\n## Number of particles")[2].partition("\n## What the paper leaves unsaid")[0]

    stored(tmp_path)
    shown = of_studies(markdown(reproduction_page.kept(tmp_path / "runs", {}, known)))
    assert shown.count("\n## ") == 3
    assert of_studies((docs / "reproduction.md").read_text(encoding="utf-8")) == shown
