"""`--log FILE`: what a command did, when, and why it ended."""

import re
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest

from rigtwin.cli import run

LINE = re.compile(r"(\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\.\d{3})Z (INFO|WARNING|ERROR|CRITICAL) (.+)")
DROP = ["simulate", "drop", "--drop-height", "100mm", "--quiet", "--out", "twin"]
PACKING = ["simulate", "packing", "--cylinder-diameter", "30mm", "--cylinder-height", "20mm", "--count", "90"]
LONG = [
    ["measure", "drop"],
    ["simulate", "pile"],
    *([name] for name in ("demo", "compare", "sweep", "calibrate", "diagnose", "reproduce")),
]


@pytest.fixture(autouse=True)
def in_a_folder_of_its_own(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def lines(file: str = "run.log") -> list[tuple[str, str]]:
    """Level and words of each line, all of which must be in the format."""
    found = [LINE.fullmatch(line) for line in Path(file).read_text().splitlines()]
    assert all(found)
    return [(match[2], match[3]) for match in found if match]


def failing(monkeypatch, error: BaseException) -> None:
    def twin(*_settings, progress, **_more):
        progress("falling", 1.0, 2.0)
        raise error

    monkeypatch.setattr("rigtwin.compare.twins.drop.drop_twin", twin)


@pytest.mark.parametrize("command", LONG, ids=" ".join)
def test_every_command_that_takes_long_has_the_option(command, capfd):
    assert run([*command, "--help"]) == 0
    assert "--log FILE" in capfd.readouterr().out


def test_steps_and_warnings_are_written_with_utc_times(capfd):
    before = datetime.now(UTC)
    assert run([*PACKING, "--log", "new/run.log", "--quiet"]) == 0
    assert capfd.readouterr() == ("", "")
    found = lines("new/run.log")
    assert "begins: " in found[0][1]
    assert ("INFO", "pouring 90/90") in found
    assert any(level == "WARNING" and "did not stay in the cylinder" in words for level, words in found)
    assert found[-1] == ("INFO", "ends with exit code 0")
    times = re.findall(r"^(\S+)Z", Path("new/run.log").read_text(), re.MULTILINE)
    for text in times:
        moment = datetime.fromisoformat(text).replace(tzinfo=UTC)
        assert before - timedelta(seconds=1) < moment < datetime.now(UTC) + timedelta(seconds=1)


def test_a_step_is_written_at_its_begin_and_end_and_not_at_every_call(monkeypatch):
    def twin(*_settings, progress, **_more):
        for k in (*range(1001), 1000):
            progress("falling", k, 1000)
        progress("waiting", 5, 0)
        raise KeyboardInterrupt

    monkeypatch.setattr("rigtwin.compare.twins.drop.drop_twin", twin)
    assert run([*DROP, "--log", "run.log"]) == 130
    steps = [words for level, words in lines()[1:-1] if level == "INFO"]
    assert steps == ["falling 0/1000", "falling 1000/1000", "waiting 5"]


def test_another_run_is_appended(capfd):
    for _ in range(2):
        assert run(["measure", "drop", "nowhere.mp4", "--log", "run.log"]) == 2
    assert sum("begins: " in words for _, words in lines()) == 2
    assert sum(words.startswith("nowhere.mp4: no such file") for _, words in lines()) == 2
    assert capfd.readouterr().err.count("\n") == 2


def test_a_refused_option_is_written(capfd):
    assert run(["measure", "drop", "x.mp4", "--bead-diameter", "6kg", "--log", "run.log"]) == 2
    said = capfd.readouterr().err.removeprefix("rigtwin: ").strip()
    assert lines()[1:] == [("ERROR", said), ("INFO", "ends with exit code 2")]


def test_a_fault_is_written_with_its_traceback_that_is_not_printed(monkeypatch, capfd):
    failing(monkeypatch, ZeroDivisionError("no time"))
    assert run([*DROP, "--log", "run.log"]) == 1
    assert "Traceback" not in capfd.readouterr().err
    written = Path("run.log").read_text()
    assert re.search(r"CRITICAL a fault of rigtwin itself \(ZeroDivisionError: no time\)", written)
    assert "Traceback (most recent call last):" in written
    assert written.splitlines()[-1].endswith("INFO ends with exit code 1")


def test_an_interrupt_is_written(monkeypatch, capfd):
    failing(monkeypatch, KeyboardInterrupt())
    assert run([*DROP, "--log", "run.log", "--json"]) == 130
    assert [level for level, _ in lines()] == ["INFO", "INFO", "WARNING", "INFO"]
    capfd.readouterr()


def test_a_run_without_the_option_writes_nothing_into_the_file_of_the_one_before(capfd):
    assert run(["measure", "drop", "nowhere.mp4", "--log", "run.log"]) == 2
    before = Path("run.log").read_bytes()
    assert run(["measure", "drop", "nowhere.mp4"]) == 2
    assert Path("run.log").read_bytes() == before
    assert capfd.readouterr().err.count("\n") == 2


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no device that is always full")
def test_a_full_disk_ends_the_log_with_one_warning_and_not_the_command(capfd):
    Path("run.log").symlink_to("/dev/full")
    assert run([*DROP, "--log", "run.log"]) == 0
    out, err = capfd.readouterr()
    assert out == ""
    assert err.count("\n") == 1
    assert "run.log" in err
    assert "the log ends here, the command goes on" in err
    assert Path("twin/quantities.json").is_file()


@pytest.mark.parametrize("name", ["clip.mp4", "folder"])
def test_what_is_no_log_is_refused_and_left_as_it_is(name, capfd):
    Path("folder").mkdir()
    Path("clip.mp4").write_bytes(b"\0\0\0 ftypisom")
    assert run([*DROP, "--log", name]) == 2
    assert f"--log: {name} is " in capfd.readouterr().err
    assert Path("clip.mp4").read_bytes() == b"\0\0\0 ftypisom"
