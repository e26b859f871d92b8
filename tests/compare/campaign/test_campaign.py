"""Campaigns: finished runs are kept, missing runs are run, failed runs have a reason, processes share the work."""

import subprocess
import sys
import time
from contextlib import closing

import numpy as np
import pytest

from rigtwin.cli import run as run_command
from rigtwin.compare.campaign.campaign import Campaign, run_all
from rigtwin.compare.campaign.run import Run
from rigtwin.compare.campaign.store import Store
from rigtwin.lab.errors import BadInput
from rigtwin.lab.reference import hlosta2020

HERE = "rigtwin.tests.compare.campaign.test_campaign"


def table(number):
    return Run(f"table-{number}", f"{HERE}:rows", {"number": number})


def rows(number, *, as_printed=False):
    return {"rows": hlosta2020.table(number, as_printed=as_printed)}


def number(value, **more):
    return Run(f"number-{value}", "builtins:dict", {"number": value, **more})


def kept(folder):
    with Store(folder, create=False) as store:
        return {row.name: row for row in store.rows()}


@pytest.mark.usefixtures("in_this_process")
def test_finished_runs_are_kept_and_not_run_again(tmp_path):
    first = run_all([table(13), table(16)], tmp_path)
    assert list(first.results) == ["table-13", "table-16"]
    with Store(tmp_path) as store:
        store.keep(table(13), {"from": "the folder"}, 1.0)
    again = run_all([table(13), table(16), table(7)], tmp_path)
    assert again.results["table-13"] == {"from": "the folder"}
    assert again.results["table-16"] == first.results["table-16"]
    assert len(again.results["table-7"]["rows"]) == 14


@pytest.mark.usefixtures("in_this_process")
def test_other_settings_are_another_run(tmp_path):
    one = Run("table", f"{HERE}:rows", {"number": 13})
    other = Run("table", f"{HERE}:rows", {"number": 13, "as_printed": True})
    assert run_all([one], tmp_path).results != run_all([other], tmp_path).results
    with Store(tmp_path) as store:
        assert len(store.rows()) == 2


def test_a_run_that_fails_says_why_and_the_others_go_on(tmp_path):
    done = run_all([table(99), table(16)], tmp_path)
    assert "no table '99'" in done.failures["table-99"]
    assert list(done.results) == ["table-16"]
    assert {name: row.state for name, row in kept(tmp_path).items()} == {"table-99": "failed", "table-16": "done"}
    with Store(tmp_path) as store, Campaign(store, lambda _jobs: pytest.fail("it was run again")) as campaign:
        done = campaign.results([table(99), table(16)], retry=False)
        assert "no table '99'" in done.failures["table-99"]


def test_a_fault_of_one_run_is_reported_and_the_others_continue_and_are_kept(tmp_path):
    faulty = Run("faulty", "operator:truediv", {})  # takes no settings by name
    done = run_all([faulty, table(16), table(99)], tmp_path)
    assert list(done.results) == ["table-16"]
    assert done.failures["faulty"].startswith("a fault of rigtwin itself (TypeError: ")
    assert list(done.faults) == ["faulty"]  # a RigtwinError is a failure, not a fault
    assert "Traceback" in done.faults["faulty"]
    assert "faulty" not in kept(tmp_path)


@pytest.mark.usefixtures("in_this_process")
def test_an_interrupt_has_a_note_on_what_is_kept(tmp_path):
    def impatient(_what, done, _whole):
        if done:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt) as stop:
        run_all([table(13), table(16)], tmp_path, progress=impatient)
    assert stop.value.__notes__ == [f"1 of 2 runs are kept in {tmp_path}; the same command runs the others."]
    assert len(kept(tmp_path)) == 1


@pytest.mark.usefixtures("in_this_process")
def test_arrays_of_a_result_are_kept_and_a_damaged_file_is_run_again(tmp_path):
    one = Run("one", f"{HERE}:with_arrays", {"count": 5})
    first = run_all([one], tmp_path).results["one"]
    again = run_all([one], tmp_path, only_kept=True).results["one"]
    assert again["label"] == first["label"] == "five"
    np.testing.assert_array_equal(again["heights"], first["heights"])
    (file,) = (tmp_path / "arrays").iterdir()
    whole = file.read_bytes()
    file.write_bytes(whole[: len(whole) // 2])
    assert not run_all([one], tmp_path, only_kept=True).results
    np.testing.assert_array_equal(run_all([one], tmp_path).results["one"]["heights"], np.arange(5) / 3)


def with_arrays(count):
    return {"label": "five", "heights": np.arange(count) / 3}


@pytest.mark.usefixtures("in_this_process")
def test_runs_that_differ_in_name_only_are_run_once(tmp_path):
    runs = [Run(name, "builtins:dict", {"number": 16}) for name in ("here", "there")]
    with Store(tmp_path) as store, Campaign(store) as campaign:
        assert list(campaign.results(runs).results) == ["here", "there"]
        assert campaign.computed == 1


def test_a_run_that_another_process_has_claimed_is_awaited_and_taken_over_when_that_process_dies(tmp_path):
    run = number(7)
    with Store(tmp_path) as store:
        holder = claim_elsewhere(tmp_path, 7)
        assert store.claim(run) == "theirs"
        holder.kill()
        holder.wait()
        assert store.claim(run) == "ours"
        assert store.claim(run) == "ours"
        store.keep(run, {"number": 7}, 0.1)
        assert store.claim(run) == "done"
    assert not list((tmp_path / "owners").iterdir())


def test_what_killed_processes_leave_is_removed_by_the_next_process_that_is_alone(tmp_path):
    with Store(tmp_path) as store:
        store.keep(number(1), {"heights": np.arange(3)}, 0.1)
    (kept_file,) = (tmp_path / "arrays").iterdir()
    left = tmp_path / "arrays" / "0123456789.npz.0a1b2c3d.part"
    killed = claim_elsewhere(tmp_path, 7)
    left.write_bytes(b"half of a file")
    with Store(tmp_path) as store:
        assert store.claim(number(8)) == "ours"
        assert left.exists()  # it may be of the process that lives
    killed.kill()
    killed.wait()
    with Store(tmp_path) as store:
        assert store.claim(number(8)) == "ours"
        assert list((tmp_path / "arrays").iterdir()) == [kept_file]
        assert len(list((tmp_path / "owners").iterdir())) == 1


def claim_elsewhere(folder, value):
    """Another process that claims ``number(value)`` and holds the claim."""
    script = (
        "import sys, time; from pathlib import Path; from rigtwin.compare.campaign.store import Store; "
        "from rigtwin.compare.campaign.run import Run; store = Store(Path(sys.argv[1])); "
        "run = Run('a', 'builtins:dict', {'number': int(sys.argv[2])}); "
        "print(store.claim(run), flush=True); time.sleep(60)"
    )
    holder = subprocess.Popen([sys.executable, "-c", script, str(folder), str(value)], stdout=subprocess.PIPE)
    assert holder.stdout.readline() == b"ours\n"
    holder.stdout.close()
    return holder


@pytest.mark.usefixtures("in_this_process")
def test_a_run_that_another_process_finishes_and_then_drops_is_computed_again(tmp_path):
    class Fleeting(Store):
        dropped = 0

        def claim(self, run):
            if not self.dropped:
                self.keep(run, {"number": 0}, 0.1)
            said = super().claim(run)
            if said == "done":
                assert run_command(["runs", str(tmp_path), "drop", run.name, "--quiet"]) == 0
                self.dropped += 1
            return said

    with Fleeting(tmp_path) as store, Campaign(store) as campaign:
        assert campaign.results([number(7)]).results == {"number-7": {"number": 7}}
        assert (store.dropped, campaign.computed) == (1, 1)


def test_two_processes_on_one_store_run_nothing_twice(tmp_path):
    script = (
        "import sys; from pathlib import Path; from rigtwin.compare.campaign.campaign import Campaign; "
        "from rigtwin.compare.campaign.store import Store; "
        "from rigtwin.compare.campaign.runners import local; "
        "from rigtwin.tests.compare.campaign.test_campaign import slow\n"
        "if __name__ == '__main__':\n"
        "    with Store(Path(sys.argv[1])) as store, Campaign(store, lambda jobs: local(jobs, 1)) as campaign:\n"
        "        done = campaign.results([slow(k) for k in range(12)]); print(campaign.computed, len(done.results))"
    )
    file = tmp_path / "campaign.py"
    file.write_text(script)
    both = [
        subprocess.Popen([sys.executable, str(file), str(tmp_path / "store")], stdout=subprocess.PIPE, text=True)
        for _ in range(2)
    ]
    said = [one.communicate(timeout=120)[0].split() for one in both]
    assert [one.returncode for one in both] == [0, 0]
    assert sum(int(computed) for computed, _ in said) == 12
    assert [found for _, found in said] == ["12", "12"]
    assert len(kept(tmp_path / "store")) == 12


def slow(value):
    return Run(f"slow-{value}", f"{HERE}:after_a_moment", {"value": value})


def after_a_moment(value):
    time.sleep(0.2)
    return {"value": value}


def test_a_folder_that_is_no_store_is_refused(tmp_path):
    with pytest.raises(BadInput, match="is no store of runs"):
        run_all([number(1)], tmp_path, only_kept=True)
    (tmp_path / "ledger.sqlite").write_text("not a ledger" * 100)
    with pytest.raises(BadInput, match="cannot be read as a ledger of runs"):
        run_all([number(1)], tmp_path)


@pytest.mark.usefixtures("in_this_process")
def test_a_store_is_read_with_pandas_alone(tmp_path):
    import sqlite3

    import pandas as pd

    run_all([number(1), number(2, size={"bead": 6.2e-3})], tmp_path)
    with closing(sqlite3.connect(tmp_path / "ledger.sqlite")) as ledger:
        assert set(pd.read_sql("select * from runs", ledger)["name"]) == {"number-1", "number-2"}
    with Store(tmp_path) as store:
        frame = store.to_frame().set_index("name")
    assert frame.loc["number-2", "settings.size.bead"] == 6.2e-3
    assert frame.loc["number-1", "result.number"] == 1
