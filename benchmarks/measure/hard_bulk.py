"""Photos and films of piles, beds, drums and hoppers of known truth, one difficulty each: are wrong numbers flagged?

    python benchmarks/measure/hard_bulk.py [--rig pile|packing|drum|hopper] [--only HARDNESS ...] [--count N]

Every picture is drawn from `SEED`; the criteria are stated in `hard_footage.py`, which does drops and pendulums.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from rigtwin.benchmarks.figures import report
from rigtwin.benchmarks.measure import draw_bulk
from rigtwin.benchmarks.measure.bulk_coverage import BEAD, CYLINDER
from rigtwin.benchmarks.measure.draw_bulk import PLAIN, Look, Photo
from rigtwin.benchmarks.measure.draw_footage import Footage, stored
from rigtwin.benchmarks.measure.hard_footage import (
    SEED,
    Reading,
    Truth,
    all_but_a_tenth,
    compared,
    fewer_frames,
    table,
    taken_up,
)
from rigtwin.lab.camera import Camera
from rigtwin.lab.errors import BadInput
from rigtwin.lab.quantity import Measurement, Quantity
from rigtwin.measure.drum import evaluate as drum
from rigtwin.measure.drum import measurement as drum_measurement
from rigtwin.measure.hopper import measurement as hopper
from rigtwin.measure.packing import measurement as packing
from rigtwin.measure.pile import evaluate as pile_evaluate
from rigtwin.measure.pile import measurement as pile

Films = dict[str, Look]


def _with(**changes: Any) -> Look:
    return Look(replace(PLAIN, **changes))


ANY: Films = {
    "clean": Look(),
    "occluder": _with(bar=True),
    "hand": _with(hand=True),
    "2.5 degrees of roll": Look(roll=2.5),
    "dark on dark": _with(ground=34.0, bead=24.0, mottle=1.0, noise=1.5),
    "bright on bright": _with(ground=205.0, bead=235.0, mottle=2.0),
    "cluttered background": Look(clutter=9),
    "glare": Look(replace(PLAIN, glare=200.0)),
    "glare below": Look(replace(PLAIN, glare=200.0), lamp=(1.0, -3.5), lamp_size=1.2),
    "noise": _with(noise=14.0),
    "compression": _with(crf=36),
    "all at once": Look(replace(PLAIN, noise=6.0, crf=28, shake=0.7, glare=60.0), roll=1.5, clutter=4),
}
OF_FILMS: Films = {
    "shake": _with(shake=1.5),
    "variable frame rate": _with(kept=all_but_a_tenth, stamped=True),
    "duplicated frames": _with(kept=lambda count, _: [k - 1 if k % 6 == 5 else k for k in range(count)]),
}
OF_BEDS: Films = {"reflections": Look(streaks=60.0), "uneven bed": Look(uneven=2.0)}
OF_HOPPERS: Films = {
    "480 fps stored at 30": Look(replace(PLAIN, rate=480.0, stored_rate=30.0)),
    "dropped frames": _with(kept=all_but_a_tenth),
}
OF_PHOTOS = ("16 bit", "turned by EXIF", "JPEG 35")


def _pile(folder: Path, look: Look, name: str, rng: np.random.Generator) -> tuple[Measurement, Truth]:
    photo, profile, base = draw_bulk.heap(look, rng)
    known = {"base_diameter": base, "bead_diameter": BEAD}
    path = _kept(folder / "heap", photo, look, name)
    truth = {
        _key(one): one.value for one in pile_evaluate.evaluate([profile], **known).quantities if "side" in one.detail
    }
    return pile.measure([path], Camera(), **known), {
        key: value for key, value in truth.items() if key[1] in ("line 15-85 %", "apex")
    }


def _packing(folder: Path, look: Look, name: str, rng: np.random.Generator) -> tuple[Measurement, Truth]:
    photo, height = draw_bulk.bed(look, rng)
    path = _kept(folder / "bed", photo, look, name)
    found = packing.measure([path], Camera(), cylinder_diameter=CYLINDER, bead_diameter=BEAD)
    return found, {("bed_height", "surface bead tops", None): height}


def _drum(folder: Path, look: Look, name: str, rng: np.random.Generator) -> tuple[Measurement, Truth]:
    pictures, angle = draw_bulk.turning(look, rng)
    footage = replace(look.footage, rate=30.0)
    path = stored(folder / "drum.mp4", list(pictures), footage, rng)
    size = draw_bulk.DRUM
    found = drum_measurement.measure(
        path, _camera(footage), drum_diameter=size, bead_diameter=size / 25, out=folder / "out"
    )
    return found, {(drum.GRAPHICAL, drum.MIDDLE, None): angle, (drum.GRAPHICAL, drum.WHOLE, None): angle}


def _hopper(folder: Path, look: Look, name: str, rng: np.random.Generator) -> tuple[Measurement, Truth]:
    look = replace(look, footage=fewer_frames(look.footage, 60.0))
    pictures, opened, last = draw_bulk.emptying(look, rng)
    path = stored(folder / "hopper.mp4", list(pictures), look.footage, rng)
    found = hopper.measure(path, _camera(look.footage), bead_diameter=BEAD, bin_width=draw_bulk.BIN, out=folder / "out")
    times = {"opening_time": opened, "last_particle_time": last, "discharge_time": last - opened}
    return found, {_key(one): times[one.quantity] for one in found.quantities if one.quantity in times}


def _camera(footage: Footage) -> Camera:
    return Camera(frame_rate=None if footage.stored_rate or footage.stamped else footage.rate)


def _kept(stem: Path, photo: Photo, look: Look, name: str) -> Path:
    """The photo as a lab keeps it: a JPEG, where it is not the file that is hard."""
    path = stem.with_suffix(".png" if name == "16 bit" else ".jpg")
    if name == "16 bit":
        cv2.imwrite(str(path), photo.astype(np.uint16) * 257)
    elif name == "turned by EXIF":
        from PIL import Image

        exif = Image.Exif()
        exif[0x0112] = 6  # to be turned clockwise by a quarter
        lying = np.ascontiguousarray(np.rot90(photo)[..., ::-1])
        Image.fromarray(lying).save(path, quality=92, exif=exif)
    else:
        quality = 35 if name == "JPEG 35" or look.footage.crf > 30 else 92
        cv2.imwrite(str(path), photo, [cv2.IMWRITE_JPEG_QUALITY, quality])
    return path


def _key(quantity: Quantity) -> tuple[str, str, object]:
    return quantity.quantity, quantity.method, quantity.detail.get("side")


RIGS = {
    "pile": (_pile, ANY | dict.fromkeys(OF_PHOTOS, Look())),
    "packing": (_packing, ANY | OF_BEDS | dict.fromkeys(OF_PHOTOS, Look())),
    "drum": (_drum, ANY | OF_FILMS),
    "hopper": (_hopper, ANY | OF_FILMS | OF_HOPPERS),
}


def readings(rig: str, name: str, seed: int, folder: Path) -> tuple[list[Reading], str]:
    """What is measured of one photo or film, or why nothing is."""
    read, looks = RIGS[rig]
    try:
        measured, truth = read(folder, looks[name], name, np.random.default_rng([seed, *name.encode()]))
    except BadInput as error:
        return [], str(error).replace(f"{folder}/", "")
    return compared(measured, truth, _key)


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rig", nargs="+", choices=tuple(RIGS), default=tuple(RIGS))
    parser.add_argument("--only", nargs="+", default=())
    parser.add_argument("--count", type=int, default=1)
    options = parser.parse_args(arguments)
    rows = []
    for rig, names in taken_up({rig: RIGS[rig][1] for rig in options.rig}, options.only).items():
        rows += table(rig, names, options.count, readings)
    return report("bench-bulk-footage", rows, seed=SEED, count=options.count)


if __name__ == "__main__":
    sys.exit(main())
