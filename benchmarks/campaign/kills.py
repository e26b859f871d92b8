"""A campaign that is killed again and again, and one that two processes share.

    SEED=1 COUNT=20 python benchmarks/campaign/kills.py

COUNT is the number of kills.  `rigtwin sweep` over a grid of 40 small packings is killed at random moments, in turn
with its workers (SIGKILL to the process group) and alone, and continued each time.  Its table must equal that of an
undisturbed run byte for byte.  Triggers in the ledger count the runs that were claimed and kept: no run may be kept
twice, and a kill may lose the runs in flight only.
"""

from __future__ import annotations

import os
import random
import signal
import sqlite3
import subprocess
import sys
import tempfile
import time
from collections import Counter
from contextlib import closing, suppress
from pathlib import Path
from typing import NamedTuple

from rigtwin.benchmarks.figures import Row, report, skipped, small
from rigtwin.compare.campaign.store import LEDGER, Store

SEED = int(os.environ.get("SEED", "1"))
COUNT = int(os.environ.get("COUNT", str(small(20, 1))))
WORKERS = small(2, 1)
PACKING = (
    "packing", "--set", "cylinder_diameter=30mm", "--wall", "PMMA", "--count", "60",
    "--vary", "static_friction=0.1..0.9:8", "--vary", "rolling_friction=0.01..0.3:5",
)  # fmt: skip
DROP = ("drop", "--set", "drop_height=0.2m", "--vary", "wall_restitution=0.3..0.9:4")
SWEEP, RUNS = small((PACKING, 40), (DROP, 4))
LONGEST = 600  # [s], of one command
ENDING = 10.0  # [s], within which the workers of a killed process must end
SHARE = 4  # mean progress of a continued campaign, over an even share of the runs for each kill

COUNTED = """
create table started (key text, owner text);
create trigger is_started after insert on claims begin insert into started values (new.key, new.owner); end;
create table ended (key text);
create trigger is_ended after insert on runs begin insert into ended values (new.key); end;
"""


class Ledger(NamedTuple):
    """What the triggers have counted."""

    started: Counter[str]  # by run
    ended: Counter[str]  # by run
    owners: Counter[str]  # runs that each process has started


def counting_store(out: Path) -> None:
    """A store in ``out/runs`` that counts."""
    Store(out / "runs").close()
    with closing(sqlite3.connect(out / "runs" / LEDGER)) as ledger:
        ledger.executescript(COUNTED)


def counted(out: Path) -> Ledger:
    with closing(sqlite3.connect(out / "runs" / LEDGER)) as ledger:
        started = ledger.execute("select key, owner from started").fetchall()
        ended = ledger.execute("select key from ended").fetchall()
    return Ledger(Counter(key for key, _ in started), Counter(key for (key,) in ended), Counter(o for _, o in started))


def sweep(out: Path, workers: int = WORKERS) -> subprocess.Popen[bytes]:
    """The sweep in a process group of its own."""
    words = [sys.executable, "-m", "rigtwin", "sweep", *SWEEP, "--workers", str(workers), "--quiet", "--out", str(out)]
    return subprocess.Popen(words, stderr=subprocess.PIPE, start_new_session=True)


def ended(process: subprocess.Popen[bytes]) -> str:
    """Empty where the process ended well, else its last words."""
    said = process.communicate(timeout=LONGEST)[1].decode(errors="replace").strip()
    return "" if process.returncode == 0 else f"exit code {process.returncode}: {said[-80:]}"


def living(group: int) -> list[int]:
    """Processes of a group that have not ended."""
    found = []
    for folder in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):  # it has just ended
            state, _, mine = (folder / "stat").read_text().rpartition(")")[2].split()[:3]
            if int(mine) == group and state != "Z":
                found.append(int(folder.name))
    return found


def left_over(group: int) -> int:
    """Number of processes of a group that do not end; they are ended here."""
    deadline = time.monotonic() + ENDING
    while (left := living(group)) and time.monotonic() < deadline:
        time.sleep(0.05)
    for one in left:
        with suppress(ProcessLookupError):
            os.kill(one, signal.SIGKILL)
    return len(left)


def temporary(out: Path) -> list[Path]:
    """Temporary files, and the lock files of processes that have ended."""
    return [file for file in out.rglob("*") if file.suffix == ".part" or file.parent.name == "owners"]


def zero(name: str, count: int, of: int, note: str = "") -> Row:
    return Row(name, float(count), "1", 0.0, f"0 of {of}", count == 0, note)


def killed(place: Path, table: bytes, seconds: float, first: float) -> list[Row]:
    """Kill the campaign, continue it, and compare its table with that of an undisturbed run.

    `seconds` is the time of an undisturbed run, `first` the time until its first run has ended [s].
    """
    chance = random.Random(SEED)
    out = place / "killed"
    counting_store(out)
    latest = first + SHARE * (seconds - first) / max(COUNT, 1)
    under_way, orphans, lost, early = 0, 0, 0, ""
    for k in range(COUNT):
        before = counted(out)
        process = sweep(out)
        with suppress(subprocess.TimeoutExpired):
            process.wait(chance.uniform(0.0, latest))
        if process.poll() is None:
            under_way += 1
            if k % 2:
                process.kill()
            else:
                os.killpg(process.pid, signal.SIGKILL)
        elif process.returncode:
            early = early or ended(process)
        orphans += left_over(process.pid)
        process.communicate()  # after its workers, which have its output open
        after = counted(out)
        in_flight = (after.started - before.started).total() - (after.ended - before.ended).total()
        lost = max(lost, in_flight)
    kept = counted(out).ended.total()
    last = sweep(out)
    said = early or ended(last)
    orphans += left_over(last.pid)
    same = not said and (out / "sweep.csv").read_bytes() == table
    ledger = counted(out)
    again = sum(number - 1 for number in ledger.ended.values())
    left = temporary(out)
    return [
        zero("killed: continued campaign fails", int(bool(said)), COUNT + 1, said),
        zero("killed: table differs from that of an undisturbed run", int(not same), 1),
        zero("killed: runs kept twice", again, RUNS),
        Row("killed: most runs lost by a kill", lost, "1", None, f"at most {WORKERS}", lost <= WORKERS),
        zero("killed: temporary files after the last run", len(left), 1, ", ".join(file.name for file in left[:2])),
        zero("killed: processes that did not end", orphans, COUNT + 1),
        Row("killed: kills of a campaign under way", under_way, note=f"of {COUNT}; {kept} of {RUNS} runs kept by then"),
        Row("killed: runs started", ledger.started.total(), note=f"for {RUNS} results"),
    ]


def shared(place: Path, table: bytes) -> list[Row]:
    """Two processes on one store at the same time."""
    out = place / "shared"
    counting_store(out)
    both = [sweep(out, 1) for _ in range(2)]
    said = [words for one in both if (words := ended(one))]
    orphans = sum(left_over(one.pid) for one in both)
    same = not said and (out / "sweep.csv").read_bytes() == table
    ledger = counted(out)
    twice = sum(number - 1 for number in ledger.started.values())
    least = min(ledger.owners.values()) if len(ledger.owners) > 1 else 0
    left = temporary(out)
    return [
        zero("two processes: end in another way", len(said), 2, said[0] if said else ""),
        zero("two processes: table differs from that of an undisturbed run", int(not same), 1),
        zero("two processes: runs started twice", twice, RUNS),
        zero("two processes: temporary files", len(left), 1, ", ".join(file.name for file in left[:2])),
        zero("two processes: processes that did not end", orphans, 2),
        Row("two processes: runs of the one that has fewer", least, note=f"of {RUNS}"),
    ]


def main() -> int:
    if not Path("/proc/self/stat").is_file():
        return report("campaign", [skipped("killed campaign", "processes are listed by /proc, which is not here")])
    with tempfile.TemporaryDirectory(prefix="rigtwin-campaign-") as name:
        place = Path(name)
        whole = place / "whole"
        counting_store(whole)
        began = time.monotonic()
        process, first = sweep(whole), 0.0
        while process.poll() is None and not first:
            time.sleep(0.1)
            first = time.monotonic() - began if counted(whole).ended else 0.0
        said = ended(process)
        seconds = time.monotonic() - began
        rows = [zero("undisturbed run fails", int(bool(said)), 1, said)]
        if not said:
            table = (whole / "sweep.csv").read_bytes()
            rows += [*killed(place, table, seconds, first or seconds), *shared(place, table)]
    note = f"{RUNS} runs, {WORKERS} at a time; first after {first:.1f} s"
    rows.append(Row("undisturbed run", seconds, "s", note=note))
    return report("campaign", rows, seed=SEED, count=COUNT)


if __name__ == "__main__":
    sys.exit(main())
