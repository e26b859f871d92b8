"""Run cases one after the other in one process, in the way of the command line."""

from __future__ import annotations

import contextlib
import io
import json
import os
import re
import resource
import shutil
import sys
import tempfile
import time
import warnings
from collections.abc import Iterator, Sequence
from concurrent.futures import Future
from dataclasses import asdict, dataclass
from pathlib import Path
from random import Random
from typing import Any, TextIO

from rigtwin.benchmarks.figures import OUT
from rigtwin.benchmarks.fuzz_cases import kinds, labs, mutations
from rigtwin.benchmarks.fuzz_cases.case import NOT_RUN, Case

LONGEST = 60.0  # [s], of a case
MEMORY = 1500.0  # [MB], of the process; the libraries take half of it
ROOM = 12 * 2**30  # [bytes] of addresses: a case that wants more must not stop other work on the machine
LONGEST_SENTENCE = 1000  # characters, of a refusal; the longest lists the keys that are known
CONTROL = re.compile(r"[\x00-\x09\x0b-\x1f\x7f-\x9f]")
FAULTS = OUT / "fuzz"


@dataclass(frozen=True)
class End:
    """How a case ended."""

    number: int
    kind: str
    code: int
    seconds: float
    peak_mb: float
    said: str
    wrong: str
    """What is wrong with it: "", or one of the reasons in `fault`, and what was said."""

    def words(self) -> str:
        """The refusal without paths, numbers and what is quoted; "" for a result."""
        text = re.sub(r"'[^']*'|\S*/\S+|[\d.+-]+(?:e[+-]?\d+)?", "_", self.said.strip())
        return text.removeprefix("rigtwin: ")[:130] if self.code == 2 else ""


def run_cases(seed: int, numbers: Sequence[int], *, every_kind: bool) -> None:
    """Run cases, with a line of JSON on stdout before and after each."""
    warnings.simplefilter("ignore")  # as the command line does
    resource.setrlimit(resource.RLIMIT_AS, (ROOM, resource.getrlimit(resource.RLIMIT_AS)[1]))
    with os.fdopen(os.dup(1), "w") as lines, _workers_in_this_process():
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        seen: set[tuple[str, str]] = set()
        for number in numbers:
            with tempfile.TemporaryDirectory(prefix="rigtwin-fuzz-", ignore_cleanup_errors=True) as name:
                mutations.begin()
                end = _run(seed, number, Path(name), every_kind, lines)
                if (end.kind, end.words()) not in seen:
                    seen.add((end.kind, end.words()))
                    mutations.keep_made()


def _run(seed: int, number: int, folder: Path, every_kind: bool, lines: TextIO) -> End:
    chance = Random(f"{seed} {number}")
    kind, write = kinds.every(number) if every_kind else kinds.drawn(chance)
    case = write(chance, folder)
    (folder / "command.json").write_text(json.dumps(case.command))
    lines.write(json.dumps({"begun": number, "kind": kind, "folder": str(folder)}) + "\n")
    lines.flush()
    end = ended(case, number, kind)
    if end.wrong:
        keep_input(folder, seed, number)
    lines.write(json.dumps(asdict(end)) + "\n")
    lines.flush()
    return end


def keep_input(folder: Path, seed: int, number: int) -> None:
    """Keep the files of a case that ended wrongly."""
    shutil.copytree(folder, FAULTS / f"{seed}-{number}", dirs_exist_ok=True)


def ended(case: Case, number: int, kind: str) -> End:
    """Run one case."""
    from rigtwin.cli import run

    shown = io.StringIO()
    _forget_peak()
    began = time.monotonic()
    with _stderr() as said, contextlib.redirect_stdout(shown), labs.read_only(case.command):
        code = run([*case.command, "--json" if case.check else "--quiet"])
    seconds = time.monotonic() - began
    peak = _peak()
    text, document = said[0], _document(shown.getvalue()) if case.check else {}
    if "error" in document and isinstance(document["error"], dict):
        text += f"rigtwin: {document['error']['message']}"
    wrong = fault(code, seconds, peak, text, listed="faults" in document.get("error", {}))
    if not wrong and code == 0 and case.check:
        different = case.check(document)
        wrong = f"wrong: {different}" if different else ""
    return End(number, kind, code, seconds, peak, text[-2000:], wrong)


def fault(code: int, seconds: float, peak: float, text: str, *, listed: bool) -> str:
    """What is wrong with the end of a case; "" for nothing."""
    lines = text.strip().splitlines()
    if code not in (0, 2):
        return f"exit: {text[-300:]}"
    if seconds > LONGEST:
        return f"hang: {seconds:.0f} s"
    if peak > MEMORY or "does not fit into memory" in text:
        return f"memory: {peak:.0f} MB, {text[-200:]}"
    head = re.match(r"rigtwin: .* has (\d+) faults:\n", text)  # of a lab.toml, on a line each
    wanted = (0 if code == 0 else 1) if head is None else 1 + int(head[1])
    if len(lines) != wanted or not all(line.startswith(("rigtwin: ", "  " if head else "rigtwin: ")) for line in lines):
        return f"words: {text[-300:]}"
    if not listed and any(len(line) > LONGEST_SENTENCE for line in lines):
        return f"words: {max(map(len, lines))} characters, {text[-300:]}"
    return f"words: {text!r}" if CONTROL.search(text) else ""


def _document(text: str) -> dict[str, Any]:
    try:
        found = json.loads(text, parse_constant=float)
    except ValueError:
        return {}
    return found if isinstance(found, dict) else {}


@contextlib.contextmanager
def _stderr() -> Iterator[list[str]]:
    """All that is written to the file of stderr, by libraries too."""
    found: list[str] = []
    before = os.dup(2)
    with tempfile.TemporaryFile() as file:
        sys.stderr.flush()
        os.dup2(file.fileno(), 2)
        try:
            yield found
        finally:
            sys.stderr.flush()
            os.dup2(before, 2)
            os.close(before)
            file.seek(0)
            found.append(file.read().decode(errors="replace"))


@contextlib.contextmanager
def _workers_in_this_process() -> Iterator[None]:
    """Measure in this process, as starting another one takes seconds; twins of many particles are not run."""
    from rigtwin.compare.measure_repetitions import measure_repetition
    from rigtwin.compare.worker_processes import Workers
    from rigtwin.lab.errors import BadInput

    def submit(_: Workers, function: Any, /, *arguments: Any) -> Future[Any]:
        job: Future[Any] = Future()
        try:
            if function is not measure_repetition:
                raise BadInput(NOT_RUN)
            job.set_result(function(*arguments))
        except Exception as error:
            job.set_exception(error)
        return job

    usual, Workers.submit = Workers.submit, submit  # type: ignore[method-assign]
    try:
        yield
    finally:
        Workers.submit = usual  # type: ignore[method-assign]


def _forget_peak() -> None:
    """Let the system begin anew to note the largest memory of this process, where it can."""
    with contextlib.suppress(OSError):
        Path("/proc/self/clear_refs").write_text("5")


def _peak() -> float:
    """Largest memory [MB] of this process since it was forgotten."""
    with contextlib.suppress(OSError):
        if found := re.search(r"VmHWM:\s+(\d+) kB", Path("/proc/self/status").read_text()):
            return int(found[1]) / 1000
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1000
