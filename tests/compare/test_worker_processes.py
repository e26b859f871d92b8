"""Worker processes end with the process that started them."""

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from concurrent.futures import Future
from contextlib import contextmanager
from multiprocessing.context import SpawnProcess
from pathlib import Path

import psutil
import pytest

from rigtwin.compare.campaign.runners import runner
from rigtwin.compare.worker_processes import spawned
from rigtwin.lab.errors import BadInput, WorkerEnded

ASKS = """
import sys
from rigtwin.compare.worker_processes import spawned
import working

if __name__ == "__main__":
    with spawned(1) as pool:
        pool.submit(working.work, sys.argv[1]).result()
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


@pytest.mark.parametrize("workers", ["a", 0, -1, 1.5, True])
def test_a_number_of_workers_that_is_none_is_refused_before_any_work(workers, tmp_path):
    with pytest.raises(BadInput, match=f"^--workers: {workers!r} is not a whole number from 1 upwards"):
        runner(None, workers, tmp_path)
    with pytest.raises(BadInput, match=r"^--workers: "), spawned(1, workers):
        pass


@pytest.mark.parametrize("how", [["asking.py"], ["-m", "asking"]])
def test_a_script_without_a_main_part_runs_once_and_its_processes_work(how, tmp_path):
    (tmp_path / "asking.py").write_text(
        "import math\nfrom rigtwin.compare.worker_processes import spawned\n"
        "with spawned(1) as pool:\n    print(pool.submit(math.sqrt, 16.0).result(), __file__, __spec__ is None)\n"
    )
    asked = subprocess.run(
        [sys.executable, *how], cwd=tmp_path, capture_output=True, text=True, timeout=120, check=False
    )
    assert (asked.returncode, asked.stderr) == (0, "")
    root, file, script = asked.stdout.split()
    assert (float(root), Path(file).name, script) == (4.0, "asking.py", str(how[0] != "-m"))


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


@contextmanager
def command(arguments: list[str], folder: Path) -> Iterator[subprocess.Popen[str]]:
    """A running rigtwin command, which does not outlive the test."""
    process = subprocess.Popen(
        [sys.executable, "-m", "rigtwin", *arguments],
        cwd=folder,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    with process:
        try:
            yield process
        finally:
            if process.poll() is None:
                os.killpg(process.pid, signal.SIGKILL)


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
    with command([*arguments, *outside, "--out", "out"], tmp_path) as process:
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
    with command([*sweep, "--vary", "static_friction=0.1,0.5", "--out", "out"], tmp_path) as process:
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


def test_a_worker_that_ends_while_another_is_started_leaves_no_process(monkeypatch):
    launch = SpawnProcess._Popen
    launched = []

    def slow_second(process):
        launched.append(process)
        if len(launched) == 2:
            assert until(lambda: not launched[0].is_alive(), 60)
            time.sleep(1.0)  # the pool notices it
        return launch(process)

    monkeypatch.setattr(SpawnProcess, "_Popen", staticmethod(slow_second))
    with pytest.raises(WorkerEnded, match="ended without a result"), spawned(2) as pool:
        list(map(Future.result, [pool.submit(os._exit, 1), pool.submit(time.sleep, 600)]))
    assert len(launched) == 2
    assert until(lambda: not any(one.is_alive() for one in launched), 30)


@pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")
def test_ctrl_c_that_another_thread_takes_while_a_worker_is_started_waits_until_it_is(monkeypatch):
    launch = SpawnProcess._Popen
    interrupt, launched = threading.Event(), []

    def take():
        interrupt.wait(60)
        signal.pthread_kill(threading.get_ident(), signal.SIGINT)

    other = threading.Thread(target=take)  # started here, so that Ctrl-C is not blocked in it
    other.start()

    def interrupted(process):
        interrupt.set()
        other.join()
        time.sleep(0.1)  # a pending interrupt would be raised here
        launched.append(process)
        return launch(process)

    monkeypatch.setattr(SpawnProcess, "_Popen", staticmethod(interrupted))
    with pytest.raises(KeyboardInterrupt), spawned(1) as pool:
        pool.submit(time.sleep, 600)
    assert len(launched) == 1
    assert until(lambda: not launched[0].is_alive(), 30)
