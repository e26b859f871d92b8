"""`rigtwin runs`: what a store holds is listed, shown, dropped and exported."""

import json
import sqlite3
from contextlib import closing

import numpy as np
import pandas as pd
import pytest

from rigtwin.cli import run
from rigtwin.compare.campaign.run import Run
from rigtwin.compare.campaign.store import Store

HEIGHTS = np.arange(5) / 3


@pytest.fixture
def folder(tmp_path):
    """Three runs, one of them failed; a list, a text and a number under one name; an array."""
    with Store(tmp_path / "results" / "runs") as store:
        store.keep(one("bed-1", 1), {"bed_height": 0.0315, "heights": HEIGHTS}, 2.5)
        store.keep(one("bed-2", "many"), {"bed_height": 0.04, "tops": [1, 2]}, 0.5)
        store.keep_failure(one("bed-3", 3), "the cylinder overflows.", 0.1)
    return tmp_path / "results"


def one(name, count):
    return Run(name, "rigtwin.somewhere:packing", {"count": count, "bead": {"diameter": 6.2e-3}})


def document(capsys, *arguments):
    assert run(["runs", *map(str, arguments), "--json"]) == 0
    return json.loads(capsys.readouterr().out)


def refused(capsys, *arguments):
    assert run(["runs", *map(str, arguments)]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    return said


def test_runs_are_listed_with_function_state_and_time(folder, capsys):
    assert run(["runs", str(folder)]) == 0
    said = capsys.readouterr().out
    assert "3 runs, 1 of them failed, 3 s of computing" in said
    (first,) = (line for line in said.splitlines() if "bed-1" in line)
    assert "packing" in first
    assert "somewhere" not in first
    assert "done" in first
    assert "2.5" in first
    listed = document(capsys, folder / "runs", "list")["runs"]
    assert {row["name"]: row["state"] for row in listed} == {"bed-1": "done", "bed-2": "done", "bed-3": "failed"}
    assert run(["runs", str(folder), "--quiet"]) == 0
    assert not capsys.readouterr().out


def test_a_run_is_shown_by_name_or_key_with_its_arrays(folder, capsys):
    shown = document(capsys, folder, "show", "bed-1")
    assert shown["settings"] == {"count": 1, "bead": {"diameter": 6.2e-3}}
    assert shown["result"] == {"bed_height": 0.0315, "heights": HEIGHTS.tolist()}
    assert document(capsys, folder, "show", shown["key"]) == shown
    assert run(["runs", str(folder), "show", "bed-1"]) == 0
    assert "array of 5, from 0 to 1.33333" in capsys.readouterr().out
    assert run(["runs", str(folder), "show", "bed-3"]) == 0
    assert "the cylinder overflows." in capsys.readouterr().out


def test_a_run_with_damaged_arrays_says_so(folder, capsys):
    (file,) = (folder / "runs" / "arrays").iterdir()
    file.write_bytes(file.read_bytes()[:50])
    assert document(capsys, folder, "show", "bed-1")["damaged"]
    assert run(["runs", str(folder), "show", "bed-1"]) == 0
    assert "missing or damaged" in capsys.readouterr().out


def test_runs_are_dropped_by_name_and_all_failed_ones_at_once(folder, capsys):
    assert run(["runs", str(folder), "drop", "bed-1"]) == 0
    assert capsys.readouterr().out == "Dropped 1 run.\n"
    assert not list((folder / "runs" / "arrays").iterdir())
    assert document(capsys, folder, "drop", "--failed")["dropped"] == [one("bed-3", 3).key]
    assert [row["name"] for row in document(capsys, folder)["runs"]] == ["bed-2"]
    assert document(capsys, folder, "drop", "--failed")["dropped"] == []


@pytest.mark.parametrize("ending", ["parquet", "csv"])
def test_an_exported_table_is_read_by_pandas(folder, tmp_path, capsys, ending):
    file = tmp_path / "new" / f"runs.{ending}"
    assert document(capsys, folder, "export", file) == {"file": str(file), "runs": 3}
    read = pd.read_parquet if ending == "parquet" else pd.read_csv
    frame = read(file).set_index("name")
    assert frame.loc["bed-1", "result.bed_height"] == 0.0315
    assert frame.loc["bed-2", "result.tops"] == "[1, 2]"
    assert frame.loc["bed-3", "message"] == "the cylinder overflows."
    assert frame["settings.bead.diameter"].tolist() == [6.2e-3] * 3
    assert [path.name for path in file.parent.iterdir()] == [file.name]


def test_an_empty_store_is_listed_and_exported(tmp_path, capsys):
    Store(tmp_path).close()
    assert run(["runs", str(tmp_path)]) == 0
    assert "0 runs" in capsys.readouterr().out
    for ending in ("csv", "parquet"):
        assert run(["runs", str(tmp_path), "export", str(tmp_path / f"runs.{ending}")]) == 0
    assert pd.read_parquet(tmp_path / "runs.parquet").empty
    assert "state" in pd.read_csv(tmp_path / "runs.csv")


def test_a_name_of_several_runs_is_refused_with_their_keys(folder, capsys):
    with Store(folder / "runs") as store:
        store.keep(one("bed-1", 7), {"bed_height": 0.05}, 1.0)
    said = refused(capsys, folder, "drop", "bed-1")
    assert "2 runs have this name" in said
    assert one("bed-1", 7).key in said


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["show"], "show: takes one name or key of a run"),
        (["show", "bed-1", "bed-2"], "2 were given"),
        (["show", "bed-9"], "neither the name nor the key"),
        (["drop"], "or give --failed"),
        (["drop", "bed-1", "bed-9"], "neither the name nor the key"),
        (["list", "bed-1"], "use show bed-1"),
        (["show", "bed-1", "--failed"], "belongs to drop"),
        (["export"], "one file"),
        (["export", "runs.xlsx"], "neither in .parquet nor in .csv"),
        (["remove"], "'remove' is not one of"),
    ],
)
def test_bad_input_is_refused_in_one_sentence_and_changes_nothing(folder, capsys, arguments, words):
    assert words in refused(capsys, folder, *arguments)
    assert len(document(capsys, folder)["runs"]) == 3


def test_a_folder_without_a_store_is_refused(tmp_path, capsys):
    assert "is no store of runs" in refused(capsys, tmp_path)
    (tmp_path / "ledger.sqlite").write_text("not a ledger" * 100)
    assert "cannot be read as a ledger of runs" in refused(capsys, tmp_path)


@pytest.mark.parametrize(
    "change",
    [
        "seconds = x'00ff'", "finished = null", "result = '{\"bed_hei'", "state = 'dome'",
        "name = cast(x'62e53f' as text)", "result = replace(result, '0.04', '0.05')",
        "seconds = 0.6",
    ],
)  # fmt: skip
def test_a_damaged_row_is_left_out_computed_again_and_can_be_dropped(folder, capsys, change):
    with closing(sqlite3.connect(folder / "runs" / "ledger.sqlite")) as ledger, ledger:
        assert ledger.execute(f"update runs set {change} where name = 'bed-2'").rowcount == 1
    listed = document(capsys, folder)
    assert {row["name"] for row in listed["runs"]} == {"bed-1", "bed-3"}
    assert listed["damaged_rows"] == 1
    assert run(["runs", str(folder)]) == 0
    assert "1 row of the ledger cannot be read, or changed after" in capsys.readouterr().err
    with Store(folder / "runs") as store:
        assert not store.find([one("bed-2", "many")])
        assert store.claim(one("bed-2", "many")) == "ours"
    assert document(capsys, folder, "drop", "--failed")["damaged_rows"] == 1
    assert run(["runs", str(folder)]) == 0
    said = capsys.readouterr()
    assert "1 run," in said.out
    assert not said.err


def test_a_ledger_without_one_of_its_columns_is_refused(folder, capsys):
    with closing(sqlite3.connect(folder / "runs" / "ledger.sqlite")) as ledger, ledger:
        ledger.execute("alter table runs drop column seconds")
    assert "is damaged, it has no seconds; put a copy of the store back" in refused(capsys, folder)


def test_runs_that_an_earlier_version_kept_without_checksums_are_used(folder, capsys):
    with closing(sqlite3.connect(folder / "runs" / "ledger.sqlite")) as ledger, ledger:
        ledger.execute("drop table checksums")
        ledger.execute("update runs set result = json_set(result, '$.arrays', json_extract(result, '$.arrays.names'))")
    listed = document(capsys, folder)
    assert (len(listed["runs"]), listed["damaged_rows"]) == (3, 0)
    with Store(folder / "runs") as store:
        assert np.array_equal(store.result(one("bed-1", 1).key)["heights"], HEIGHTS)


def test_arrays_of_another_run_are_not_believed(folder, capsys):
    with Store(folder / "runs") as store:
        store.keep(one("bed-4", 4), {"bed_height": 0.0315, "heights": 2 * HEIGHTS}, 2.5)
        arrays = [folder / "runs" / "arrays" / f"{one(*each).key}.npz" for each in (("bed-1", 1), ("bed-4", 4))]
        arrays[0].write_bytes(arrays[1].read_bytes())
        assert list(store.find([one("bed-1", 1), one("bed-4", 4)])) == ["bed-4"]
    assert document(capsys, folder, "show", "bed-1")["damaged"]
