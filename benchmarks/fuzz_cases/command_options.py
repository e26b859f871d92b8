"""Options of several commands with numbers of any size, other units, and texts that are none."""

from __future__ import annotations

import re
from pathlib import Path
from random import Random

from rigtwin.benchmarks.fuzz_cases.case import Case, out, written
from rigtwin.benchmarks.fuzz_cases.films import film
from rigtwin.benchmarks.fuzz_cases.labs import LAB, STATED
from rigtwin.benchmarks.fuzz_cases.media import heap
from rigtwin.benchmarks.fuzz_cases.mutations import in_words, number
from rigtwin.benchmarks.fuzz_cases.tables import table

SIMULATE = ["--drop-height", "200mm", "--restitution", "0.5", "--frame-rate", "240Hz", "--bounces", "3"]
FILM = [
    *("--frame-rate", "240Hz", "--scale", "0.2mm/px", "--region", "0,0,60,48", "--start", "0f", "--end", "11f"),
    *("--exclude", "3f..4f", "--camera-roll", "1deg", "--plumb-line", "3,0,3,40", "--ignore", "0,0,4,4"),
    *("--bead-at", "0:32,10", "--centre", "3:32,20", "--plate", "0,42,63,42", "--known-length", "10mm:0,0,30,0"),
    *("--bead-diameter", "6mm", "--bead-density", "568kg/m^3", "--bead-mass", "0.69g"),
]
TABLE = ["--bead-diameter", "6mm", "--bead-density", "568kg/m^3", "--frame-rate", "240Hz", "--scale", "1mm/px"]
PHOTO = [
    *("--base-diameter", "90mm", "--bead-diameter", "6mm", "--scale", "0.5mm/px", "--region", "0,0,200,150"),
    *("--camera-roll", "0deg", "--base", "20,120,200,120", "--ignore", "0,0,4,4", "--flank", "left"),
]
DECK = {
    "packing": ["--cylinder-diameter", "65mm", "--cylinder-height", "302mm", "--fall-height", "20mm"],
    "pile": ["--base-diameter", "90mm", "--rim-height", "10mm", "--outlet-height", "80mm", "--settle-limit", "4s"],
    "drum": ["--drum-diameter", "140mm", "--speed", "3rpm", "--depth", "20mm", "--turns", "1"],
    "hopper": ["--outlet", "34mm", "--bin-width", "104mm", "--depth", "40mm"],
}
DECK_MORE = [
    *("--restitution", "0.5", "--static-friction", "0.4", "--rolling-friction", "0.1", "--count", "60", "--seed", "1"),
    *("--stiffness-factor", "0.001", "--time-step-fraction", "0.3", "--pour-rate", "400/s"),
]
SWEEP = [
    *("--vary", "static_friction=0.05..1.5:8", "--set", "cylinder_diameter=65mm", "--count", "60", "--points", "4"),
    *("--repetitions", "1", "--design", "grid", "--stiffness-factor", "0.001", "--rolling-model", "C"),
]


def changed(chance: Random, words: list[str], count: int) -> list[str]:
    """`count` of the pairs of option and value, some values exchanged."""
    pairs = [words[k : k + 2] for k in range(0, len(words), 2)]
    kept = sorted(chance.sample(range(len(pairs)), min(count, len(pairs))))
    found = [list(pairs[k]) for k in kept]
    for _ in range(chance.choice((1, 1, 2))):
        pair = chance.choice(found)
        if chance.random() < 0.5:
            pair[1] = in_words(chance, pair[1]).decode(errors="replace")
        else:
            unit = re.sub(r"^[\d.]+", "", pair[1]) if chance.random() < 0.8 else chance.choice(("mm", "Hz", "deg", ""))
            pair[1] = number(chance, unit)
    return [f"{name}={value}".replace("\0", "") for name, value in found]


def of_simulate(chance: Random, folder: Path) -> Case:
    """Options of ``simulate drop``."""
    words = [*SIMULATE[:2], *changed(chance, SIMULATE[2:], 4)]
    if chance.random() < 0.5:
        words = changed(chance, SIMULATE, 5)
    return Case(["simulate", "drop", *words, *out(folder)])


def of_measure(chance: Random, folder: Path) -> Case:
    """Options of ``measure`` with a film, a table or a photo."""
    kind = chance.randrange(5)
    if kind == 0:
        path = written(folder, "view.jpg", heap(".jpg"))
        return Case(["measure", "pile", path, *changed(chance, PHOTO, 4), *out(folder)])
    if kind == 1:
        path = written(folder, "r01.csv", table())
        return Case(["measure", "drop", path, *changed(chance, TABLE, 3), *out(folder)])
    path = written(folder, "r01.mp4", film("mp4", "libx264", "yuv420p"))
    return Case(["measure", "drop", path, *changed(chance, FILM, 5), *out(folder)])


def of_export(chance: Random, folder: Path) -> Case:
    """Options of ``export`` for three codes and four rigs."""
    rig = chance.choice(list(DECK))
    code = chance.choice(("liggghts", "lammps", "yade"))
    options = changed(chance, DECK_MORE, 4) if chance.random() < 0.5 else changed(chance, DECK[rig], 3)
    required = [] if any(word.startswith(DECK[rig][0]) for word in options) else DECK[rig][:2]
    return Case(["export", code, rig, *required, *options, *out(folder)])


def of_sweep(chance: Random, folder: Path) -> Case:
    """Options of ``sweep``."""
    written(folder, "lab.toml", LAB + STATED)
    options = changed(chance, SWEEP[2:], 4)
    vary = in_words(chance, SWEEP[1]).decode(errors="replace").replace("\0", "") if chance.random() < 0.6 else SWEEP[1]
    where = chance.choice(("packing", "pile", "drop", str(folder)))
    return Case(["sweep", where, f"--vary={vary}", "--workers", "1", *options, *out(folder)])
