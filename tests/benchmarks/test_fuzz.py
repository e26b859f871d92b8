"""What `make fuzz` calls wrong: each kind of bad end, and a number that was read as another one."""

import json

import pytest

from rigtwin.benchmarks.fuzz_cases.reference import same_track
from rigtwin.benchmarks.fuzz_cases.running import fault
from rigtwin.cli import run

SENTENCE = "rigtwin: a.csv: holds no numbers; export it again.\n"


@pytest.mark.parametrize(
    ("code", "seconds", "peak", "text", "reason"),
    [
        (0, 1.0, 300.0, "", ""),
        (2, 1.0, 300.0, SENTENCE, ""),
        (2, 1.0, 300.0, "rigtwin: lab.toml has 2 faults:\n  one\n  two\n", ""),
        (1, 1.0, 300.0, SENTENCE, "exit"),
        (-11, 1.0, 300.0, "", "exit"),
        (2, 61.0, 300.0, SENTENCE, "hang"),
        (0, 1.0, 1600.0, "", "memory"),
        (0, 1.0, 300.0, "a warning of a library\n", "words"),
        (2, 1.0, 300.0, "", "words"),
        (2, 1.0, 300.0, SENTENCE * 2, "words"),
        (2, 1.0, 300.0, f"libpng warning\n{SENTENCE}", "words"),
        (2, 1.0, 300.0, "rigtwin: lab.toml has 3 faults:\n  one\n  two\n", "words"),
        (2, 1.0, 300.0, "rigtwin: '\x1b[2J' is no length.\n", "words"),
        (2, 1.0, 300.0, f"rigtwin: {'long ' * 1000}.\n", "words"),
    ],
)
def test_an_end_is_a_result_or_one_sentence_soon_and_in_little_memory(code, seconds, peak, text, reason):
    assert fault(code, seconds, peak, text, listed=False).partition(":")[0] == reason


def test_a_table_that_was_changed_after_it_was_read_is_called_wrong(tmp_path, capsys):
    path = tmp_path / "a.csv"
    fall = [(k / 240, 0.2 - 9.81 * (k / 240) ** 2 / 2) for k in range(48)]
    rows = [*fall, *((2 * fall[-1][0] - time, height) for time, height in reversed(fall[:-1]))]
    path.write_text("time_s,x_m,y_m\n" + "".join(f"{time:.6f},0,{height:.6f}\n" for time, height in rows))
    assert run(["measure", "drop", str(path), "--out", str(tmp_path / "out"), "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert same_track(path, document) == ""
    path.write_text(path.read_text() + "0.5,0,0.1\n")
    assert same_track(path, document) != ""
