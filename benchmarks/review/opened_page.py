"""Start the page of `rigtwin review`, and use it in headless Chromium as a person does.

The benchmark `page_speed` and the tests of the page share it.
"""

from __future__ import annotations

import re
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
PATIENCE = 180_000  # [ms], for a measurement on a busy machine

Point = tuple[float, float]  # [px] of the picture


@dataclass
class Server:
    """The server of a page, and how it ended."""

    address: str
    exit_code: int | None = None  # None while it runs
    said: str = ""  # on stderr


@contextmanager
def served(lab: Path, *options: str) -> Iterator[Server]:
    """The server of the page of a lab; it is ended with Ctrl-C."""
    words = [sys.executable, "-m", "rigtwin", "review", str(lab), "--no-browser", *options]
    with subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        found = re.search(r"http://127\.0\.0\.1:\S+", process.stdout.readline())
        server = Server(found[0] if found is not None else "")
        try:
            assert server.address, "the server has not started"
            yield server
        finally:
            process.send_signal(signal.SIGINT)
            server.said = process.communicate(timeout=20)[1]
            server.exit_code = process.returncode


class OpenedPage:
    """A tab of the browser that shows the page.

    Parameters
    ----------
    tab : playwright.sync_api.Page
        The tab.
    """

    def __init__(self, tab: Any) -> None:
        self.page = tab

    def shown(self) -> None:
        """Wait for a picture."""
        self.page.locator("html[data-frame]").wait_for(state="attached")

    def measured(self) -> None:
        """Wait for the numbers."""
        self.page.locator("#state", has_text="(in").wait_for(timeout=PATIENCE)

    def show(self, name: str) -> None:
        """Choose a repetition, and wait for its picture."""
        self.page.locator("#list button", has_text=name).click()
        self.page.locator("#list [aria-current=true]", has_text=name).wait_for()
        self.shown()

    def frame(self, index: int) -> None:
        """Wait for a frame."""
        self.page.locator(f'html[data-frame="{index}"]').wait_for(state="attached")

    def slide_to(self, index: int) -> None:
        """Move the slider to a frame, and wait for it."""
        move = "(it, to) => { it.value = to; it.dispatchEvent(new Event('input')); }"
        self.page.locator("#slider").evaluate(move, index)
        self.frame(index)

    def at(self, x: float, y: float) -> Point:
        """Where a place of the picture is on the screen."""
        left, top, width, height = self.page.locator("#overlay").evaluate(
            "svg => { const b = svg.getBoundingClientRect(); return [b.left, b.top, b.width, b.height]; }"
        )
        _, _, wide, tall = map(float, self.page.locator("#overlay").get_attribute("viewBox").split())
        return left + (x + 0.5) / wide * width, top + (y + 0.5) / tall * height

    def pull(self, start: Point, end: Point) -> None:
        """Drag from one place to another; the button of the mouse is still down then."""
        mouse = self.page.mouse
        mouse.move(*self.at(*start))
        mouse.down()
        mouse.move(*self.at((start[0] + end[0]) / 2, (start[1] + end[1]) / 2))
        mouse.move(*self.at(*end))

    def choose(self, tool: str) -> None:
        """Press the button of a place."""
        self.page.locator("#tools .tool > button", has_text=tool).first.click()
