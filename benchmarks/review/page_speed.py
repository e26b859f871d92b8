"""The page of `rigtwin review` in headless Chromium: first frame, scrubbing, measuring again after a drag.

    python benchmarks/review/page_speed.py [--pictures docs/pictures]

A clip of 1920 x 1080 px is scrubbed at several speeds; a heap of four photos, a bed and a drop are measured again after
a place was dragged.  With `--pictures` the pictures of docs/review.md are taken instead.  Needs Chromium and the
development group.
"""

from __future__ import annotations

import argparse
import shutil
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from rigtwin.benchmarks.figures import Row, below, report, skipped, small
from rigtwin.benchmarks.measure.speed import draw_clip
from rigtwin.benchmarks.review.opened_page import CHROMIUM, OpenedPage, Point, served

MEDIA = Path(__file__).resolve().parents[2] / "sample_media"
SECONDS = small(2.0, 1.0)  # of the clip at 240 frames per second
SCRUBBED = {
    "slowly, on": (0, 0.3, 4),
    "slowly, back": (0.3, 0, 4),
    "quickly, on": (0, 1, 5),
    "quickly, back": (1, 0, 5),
}
"""From where to where, in parts of the clip, in how many seconds."""

CLIP = """
[[experiments]]
id = "drop"
rig = "drop"
particle = "D12"
wall = "steel"
repetitions = ["long.mp4"]

[experiments.camera]
frame_rate = "240 Hz"
scale = "0.3 mm/px"
"""
BED = """
[[experiments]]
id = "bed"
rig = "packing"
particle = "D6"
wall = "PMMA"
cylinder_diameter = "50 mm"
repetitions = ["packing.jpg"]
"""

SCRUB = """async ([from, to, seconds]) => {
  const slider = document.getElementById("slider");
  const last = Number(slider.max);
  const shown = [];
  const watch = new MutationObserver(() => shown.push(performance.now()));
  watch.observe(document.documentElement, { attributes: true, attributeFilter: ["data-frame"] });
  const begun = performance.now();
  await new Promise((done) => {
    const step = () => {
      const part = Math.min((performance.now() - begun) / (1000 * seconds), 1);
      slider.value = Math.round(last * (from + part * (to - from)));
      slider.dispatchEvent(new Event("input"));
      if (part < 1) requestAnimationFrame(step); else done();
    };
    step();
  });
  watch.disconnect();
  return [shown.length / seconds, Math.max(...shown.slice(1).map((at, k) => at - shown[k])) / 1000];
}"""


def sample_lab(folder: Path) -> Path:
    shutil.copytree(MEDIA, folder, ignore=shutil.ignore_patterns("renderer", "seven_rigs"))
    shutil.copy(MEDIA / "seven_rigs" / "packing.jpg", folder)
    (folder / "lab.toml").write_text((MEDIA / "lab.toml").read_text() + BED)
    return folder


class Page(OpenedPage):
    """The page, and how soon it answers."""

    def __init__(self, browser: Any, address: str) -> None:
        super().__init__(browser.new_page(viewport={"width": 1280, "height": 800}))
        begun = time.perf_counter()
        self.page.goto(address, wait_until="commit")
        self.shown()
        self.first = time.perf_counter() - begun

    def show(self, name: str) -> None:
        super().show(name)
        self.measured()

    def drag(self, start: Point, end: Point) -> float:
        """Seconds from the release of the button to the new numbers."""
        self.pull(start, end)
        known = self.page.locator("html").get_attribute("data-result")
        begun = time.perf_counter()
        self.page.mouse.up()
        self.page.locator(f'html[data-result]:not([data-result="{known}"])').wait_for(state="attached", timeout=60_000)
        return time.perf_counter() - begun


def figures(browser: Any, folder: Path) -> list[Row]:
    clip = folder / "clip"
    clip.mkdir()
    draw_clip(clip / "long.mp4", SECONDS)
    (clip / "lab.toml").write_text(CLIP)
    rows = []
    first = []
    for _ in range(small(5, 1)):
        with served(clip) as server:
            first.append(Page(browser, server.address).first)
    note = f"from the address on, median of {', '.join(f'{each:.2f}' for each in first)}"
    rows.append(below("1920 x 1080 px clip: first frame", float(np.median(first)), 1.0, unit="s", note=note))
    with served(clip) as server:
        page = Page(browser, server.address)
        page.measured()
        for how, (start, end, seconds) in SCRUBBED.items():
            rate, longest = page.page.evaluate(SCRUB, [start, end, small(seconds, 1)])
            note = f"longest pause {longest:.2f} s"
            rows.append(Row(f"scrubbing {how}", rate, "1/s", None, "at least 15", rate >= 15, note))
    with served(sample_lab(folder / "lab")) as server:
        page = Page(browser, server.address)
        page.show("pile/view1.jpg")
        times = [page.drag((180.6 + 8 * k, 432.7), (180.6 + 8 * (k + 1), 432.7)) for k in range(small(4, 1))]
        rows.append(below("heap of four photos: numbers after a drag", float(np.median(times)), 1.0, unit="s"))
        page.show("packing.jpg")
        page.choose("Cylinder walls")
        rows.append(below("bed: numbers after a drag", page.drag((104, 600), (447, 600)), 1.0, unit="s"))
        page.show("drop/r02.mp4")
        page.choose("Region")
        rows.append(below("drop, 168 frames: numbers after a drag", page.drag((60, 20), (330, 790)), 3.0, unit="s"))
    return rows


def pictures(browser: Any, folder: Path, out: Path) -> list[Row]:
    with served(sample_lab(folder / "lab")) as server:
        page = Page(browser, server.address)
        page.show("pendulum/r01.mp4")
        page.slide_to(95)
        _save(page, out / "review-clip.webp")
        page.page.emulate_media(color_scheme="dark")
        page.show("pile/view1.jpg")
        page.drag((180.6, 432.7), (184, 425))
        page.measured()
        _save(page, out / "review-heap.webp")
    return [Row("pictures", 2)]


def _save(page: Page, path: Path) -> None:
    picture = cv2.imdecode(np.frombuffer(page.page.screenshot(), dtype=np.uint8), cv2.IMREAD_COLOR)
    cv2.imwrite(str(path), picture, [cv2.IMWRITE_WEBP_QUALITY, 75])


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--pictures", type=Path, help="folder for the pictures of docs/review.md")
    options = parser.parse_args(arguments)
    if CHROMIUM is None:
        return report("bench-review", [skipped("page", "no Chromium is installed")])
    from playwright.sync_api import sync_playwright

    with tempfile.TemporaryDirectory() as name, sync_playwright() as started:
        browser = started.chromium.launch(executable_path=CHROMIUM)
        if options.pictures is not None:
            pictures(browser, Path(name), options.pictures)
            return 0
        rows = figures(browser, Path(name))
    return report("bench-review", rows)


if __name__ == "__main__":
    sys.exit(main())
