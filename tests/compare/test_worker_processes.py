"""Worker processes end with the process that started them."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import psutil
import pytest

ASKS = """
import sys
from rigtwin.compare.worker_processes import interrupts_held, spawned
import working

if __name__ == "__main__":
    with spawned(1) as pool:
        with interrupts_held():
            job = pool.submit(working.work, sys.argv[1])
        job.result()
"""

WORKS = """
import time

def work(written):
    with open(written, "w") as file:
        for _ in range(1200):
            file.write("at work\\n")
            file.flush()
            time.sleep(0.1)
"""


def until(happened, within: float) -> bool:
    deadline = time.monotonic() + within
    while not happened() and time.monotonic() < deadline:
        time.sleep(0.05)
    return bool(happened())


def rests(written: Path) -> bool:
    """Whether nothing is written for a second, ten times the interval between two writes of a worker."""
    before = written.stat().st_size
    time.sleep(1.0)
    return written.stat().st_size == before


@pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")
@pytest.mark.parametrize("end", [signal.SIGTERM, signal.SIGKILL])
def test_no_worker_outlives_the_process_that_is_killed(end, tmp_path):
    (tmp_path / "asking.py").write_text(ASKS)
    (tmp_path / "working.py").write_text(WORKS)
    written = tmp_path / "worker"
    asking = subprocess.Popen([sys.executable, "asking.py", written], cwd=tmp_path)
    assert until(lambda: written.exists() and written.stat().st_size, 60)
    asking.send_signal(end)
    asking.wait()
    assert until(lambda: rests(written), 30)


def workers(process: subprocess.Popen[str]) -> list[psutil.Process]:
    children = psutil.Process(process.pid).children()
    return [one for one in children if any("spawn_main" in word for word in one.cmdline())]


LAB = """\
[[experiments]]
id = "drop"
rig = "drop"
particle = "D6"
wall = "steel"
drop_height = "264 mm"
repetitions = ["r01.mp4"]
"""


@pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")
@pytest.mark.parametrize(
    ("arguments", "work", "less"),
    [
        (["compare", "lab"], "measured a repetition", "give shorter clips or smaller photos"),
        (
            [
                "sweep",
                "packing",
                "--set",
                "cylinder_diameter=45mm",
                "--count",
                "20000",
                "--vary",
                "static_friction=0.1,0.5",
            ],
            "ran a twin",
            "use fewer --workers",
        ),
    ],
    ids=["compare", "sweep"],
)
def test_a_worker_that_is_killed_ends_the_command_with_one_sentence_and_no_other_worker(
    arguments, work, less, tmp_path
):
    (tmp_path / "lab").mkdir()
    (tmp_path / "lab" / "lab.toml").write_text(LAB)
    (tmp_path / "lab" / "r01.mp4").symlink_to(Path(__file__).parents[2] / "sample_media" / "drop" / "r01.mp4")
    outside = ["--allow-outside"] if arguments[0] == "compare" else ["--workers", "2"]
    command = [sys.executable, "-m", "rigtwin", *arguments, *outside, "--out", "out"]
    process = subprocess.Popen(command, cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert until(lambda: workers(process), 60)
    started = workers(process)
    started[0].kill()
    out, err = process.communicate(timeout=60)
    assert (process.returncode, out) == (2, "")
    assert err == (
        f"rigtwin: a process that {work} ended without a result, most likely because memory ran out; "
        f"close other programs and run again, or {less}.\n"
    )
    assert until(lambda: not any(one.is_running() for one in started), 30)


@pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")
def test_ctrl_c_twice_ends_with_one_sentence_and_no_worker(tmp_path):
    sweep = ["sweep", "packing", "--set", "cylinder_diameter=45mm", "--count", "20000"]
    command = [sys.executable, "-m", "rigtwin", *sweep, "--vary", "static_friction=0.1,0.5", "--out", "out"]
    process = subprocess.Popen(
        command, cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True
    )
    assert until(lambda: workers(process), 60)
    started = workers(process)
    for _ in range(2):
        os.killpg(process.pid, signal.SIGINT)
        time.sleep(0.02)
    out, err = process.communicate(timeout=60)
    assert (process.returncode, out) == (130, "")
    assert err.startswith("rigtwin: interrupted; 0 of 2 runs are kept in out/runs")
    assert err.count("\n") == 1
    assert until(lambda: not any(one.is_running() for one in started), 30)
