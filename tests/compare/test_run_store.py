"""Run store: finished runs are kept, missing runs are run, failed runs have a reason."""

import json

import pytest

from rigtwin.compare.run_store import Run, run_all


def table(number):
    return Run(f"table-{number}", "rigtwin.lab.reference.hlosta2020:table", {"number": number})


@pytest.mark.usefixtures("in_this_process")
def test_finished_runs_are_kept_and_not_run_again(tmp_path):
    first = run_all([table(13), table(16)], tmp_path)
    assert list(first.results) == ["table-13", "table-16"]
    for file in tmp_path.glob("table-13-*.json"):
        record = json.loads(file.read_text())
        record["result"] = {"from": "the folder"}
        file.write_text(json.dumps(record))
    again = run_all([table(13), table(16), table(7)], tmp_path)
    assert again.results["table-13"] == {"from": "the folder"}
    assert again.results["table-16"] == first.results["table-16"]
    assert len(again.results["table-7"]) == 14


@pytest.mark.usefixtures("in_this_process")
def test_other_settings_are_another_run(tmp_path):
    one = Run("table", "rigtwin.lab.reference.hlosta2020:table", {"number": 13})
    other = Run("table", "rigtwin.lab.reference.hlosta2020:table", {"number": 13, "as_printed": True})
    assert run_all([one], tmp_path).results != run_all([other], tmp_path).results
    assert len(list(tmp_path.iterdir())) == 2


def test_a_run_that_fails_says_why_and_the_others_go_on(tmp_path):
    done = run_all([table(99), table(16)], tmp_path)
    assert "no table '99'" in done.failures["table-99"]
    assert list(done.results) == ["table-16"]
    assert len(list(tmp_path.iterdir())) == 1


def test_a_fault_of_one_run_is_reported_and_the_others_continue_and_are_kept(tmp_path):
    faulty = Run("faulty", "operator:truediv", {})  # takes no settings by name
    done = run_all([faulty, table(16), table(99)], tmp_path, workers=1)
    assert list(done.results) == ["table-16"]
    assert done.failures["faulty"].startswith("a fault of rigtwin itself (TypeError: ")
    assert list(done.faults) == ["faulty"]  # a RigtwinError is a failure, not a fault
    assert "Traceback" in done.faults["faulty"]
    assert len(list(tmp_path.iterdir())) == 1


def test_an_interrupt_has_a_note_on_what_is_kept(tmp_path):
    def impatient(_what, done, _whole):
        if done:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt) as stop:
        run_all([table(13), table(16)], tmp_path, workers=1, progress=impatient)
    assert stop.value.__notes__ == [f"1 of 2 runs are kept in {tmp_path}; the same command runs the others."]
    assert len(list(tmp_path.iterdir())) == 1


@pytest.mark.usefixtures("in_this_process")
def test_a_truncated_or_damaged_result_is_run_again(tmp_path):
    one = Run("one", "builtins:dict", {"number": 16})
    run_all([one], tmp_path)
    (file,) = tmp_path.iterdir()
    whole = file.read_text()
    assert run_all([one], tmp_path, only_kept=True).results == {"one": {"number": 16}}
    for left in (whole[: len(whole) // 2], "[]", "null", "3", '{"result": 5}', '{"result": {}}', '{"result": null}'):
        file.write_text(left)
        assert not run_all([one], tmp_path, only_kept=True).results, left
    assert run_all([one], tmp_path).results == {"one": {"number": 16}}
    assert file.read_text() == whole
