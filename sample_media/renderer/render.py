"""Make the sample media and their truth again.

``python sample_media/renderer/render.py [--only drop|pendulum|pile]``
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from pathlib import Path
from typing import Any

from rigtwin.sample_media.renderer import draw_drop, draw_pendulum, draw_pile
from rigtwin.sample_media.renderer.footage import write_clip, write_photo

HERE = Path(__file__).resolve().parents[1]
CONVENTIONS = {
    "pixels": "u to the right, v down, the centre of the top-left pixel is (0, 0)",
    "time": "frame i starts its exposure at frame_start_s[i]; positions and angles are those at mid-exposure",
    "drop": "x right, y away from the camera, z up; origin where the bead's fall meets the plate; "
    "heights are of the bead's lowest point above the plate; restitution is the ratio of speeds normal to the plate",
    "pendulum": "x right, z up; origin midway between the hinges; angles from the vertical, to the right positive; "
    "speeds along the arc, to the right positive; restitution is speed of parting over speed of approach",
    "pile": "x right, y away from the camera, z up from the top of the plate, origin on its axis; a view shows it "
    "after the plate was turned by plate_turned_deg counter-clockwise seen from above; the profile is the outline seen "
    "by parallel rays; graphical: line of least orthogonal distances through the outline between the outermost points "
    "at the two fractions of the heap's height; geometric: atan(2 H / base diameter)",
    "roll": "camera_roll_deg is positive when the scene looks turned clockwise in the picture",
}


def main() -> None:
    """Render what is asked for, then write the whole truth."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", choices=("drop", "pendulum", "pile"))
    parser.add_argument("--out", type=Path, default=HERE, help="folder to write to (default: beside this script)")
    choice = parser.parse_args()
    for rig in ("drop", "pendulum", "pile"):
        if choice.only in (None, rig):
            (choice.out / rig).mkdir(parents=True, exist_ok=True)
            _render(rig, choice.out)
    text = json.dumps(_rounded(truth()), separators=(",", ":"))
    partial = choice.out / "truth.json.part"
    partial.write_text(text + "\n", encoding="utf-8")
    partial.replace(choice.out / "truth.json")


def _render(rig: str, out: Path) -> None:
    if rig == "drop":
        for name in draw_drop.SETTINGS:
            with _Progress(f"drop/{name}.mp4"):
                write_clip(out / f"drop/{name}.mp4", draw_drop.clip(name), draw_drop.FRAME_RATE, crf=17)
    elif rig == "pendulum":
        for name in draw_pendulum.SETTINGS:
            with _Progress(f"pendulum/{name}.mp4"):
                write_clip(out / f"pendulum/{name}.mp4", draw_pendulum.clip(name), draw_pendulum.FRAME_RATE, crf=17)
    else:
        for name in draw_pile.VIEWS:
            with _Progress(f"pile/{name}.jpg"):
                write_photo(out / f"pile/{name}.jpg", draw_pile.photo(name), quality=88)


def truth() -> dict[str, Any]:
    """Everything that is known of the media; needs no rendering."""
    return {
        "conventions": CONVENTIONS,
        "drop": {name: draw_drop.truth(name) for name in draw_drop.SETTINGS},
        "pendulum": {name: draw_pendulum.truth(name) for name in draw_pendulum.SETTINGS},
        "pile": draw_pile.truth(),
    }


def _rounded(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _rounded(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_rounded(item) for item in value]
    return float(f"{value:.8g}") if isinstance(value, float) else value


class _Progress:
    """Says on stderr what is being made and how long it took."""

    def __init__(self, what: str) -> None:
        self.what = what

    def __enter__(self) -> None:
        self.start = time.perf_counter()

    def __exit__(self, *reason: object) -> None:
        sys.stderr.write(f"{self.what}: {time.perf_counter() - self.start:.0f} s\n")


if __name__ == "__main__":
    main()
