"""Start the page of a lab as the command does."""

import re
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest


@contextmanager
def _served(lab: Path, *options: str) -> Iterator[str]:
    words = [sys.executable, "-m", "rigtwin", "review", str(lab), "--no-browser", *options]
    with subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as server:
        try:
            yield re.search(r"http://127\.0\.0\.1:\S+", server.stdout.readline())[0]
        finally:
            server.send_signal(signal.SIGINT)
            said = server.communicate(timeout=20)[1]
        assert server.returncode == 130
        assert said.startswith("rigtwin: the page is closed"), said
        assert said.count("\n") == 1, said


@pytest.fixture(scope="session")
def served() -> Callable[..., object]:
    """`with served(lab) as address`: the page of a lab, ended with Ctrl-C, after which one sentence is said."""
    return _served
