"""Worker processes end with the process that started them."""

import signal
import subprocess
import sys
import time
from pathlib import Path

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
