"""Start the page of a lab as the command does."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from rigtwin.benchmarks.review import opened_page


@contextmanager
def _served(lab: Path, *options: str) -> Iterator[str]:
    with opened_page.served(lab, *options) as server:
        yield server.address
    assert server.exit_code == 130
    assert server.said.startswith("rigtwin: the page is closed"), server.said
    assert server.said.count("\n") == 1, server.said


@pytest.fixture(scope="session")
def served() -> Callable[..., object]:
    """`with served(lab) as address`: the page of a lab, ended with Ctrl-C, after which one sentence is said."""
    return _served
