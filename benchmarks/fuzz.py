"""Damaged and absurd input: every command ends with a result, or with one sentence, or a list, and exit code 2.

    SEED=1 COUNT=300 python benchmarks/fuzz.py

Files that are right (lab.toml, lab.json, a table, model.toml, a photo, a film) and options are changed by chance: bytes
flipped, cut, doubled, numbers made extreme, words exchanged.  The commands run one after the other in a process of its
own, in the way of the command line; where that process dies, the next one goes on behind the case.
"""

from __future__ import annotations

import contextlib
import io
import json
import os
import random
import re
import resource
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path

from rigtwin.benchmarks.figures import Row, report, small

SEED = int(os.environ.get("SEED", "1"))
COUNT = int(os.environ.get("COUNT", str(small(300, 12))))
LONGEST = 60.0  # [s], of a case; each takes a second or some on the right input
MEMORY = 2500.0  # [MB], of the process; Taichi and the libraries of measuring take some hundred

SAMPLES = Path(__file__).resolve().parent.parent / "sample_media"
EXTREMES = ("0", "-1", "1e-300", "1e300", "nan", "inf", "1e15", "999999999999", "", "'", "%s", "../..", "\0", "é")
LAB = """[lab]
title = "Bench"
[materials.ash]
density = "720 kg/m^3"
youngs_modulus = "11 GPa"
poisson_ratio = 0.44
[particles.bead]
material = "ash"
diameter = "6 mm"
density = "568 kg/m^3"
[contacts.bead-steel]
restitution = 0.42
static_friction = 0.36
rolling_friction = 0.06
[[experiments]]
id = "drop"
rig = "drop"
particle = "bead"
wall = "steel"
drop_height = "200 mm"
repetitions = ["r01.csv"]
[experiments.camera]
frame_rate = "240 Hz"
"""
MODEL = """[materials.ash]
density = 720
youngs_modulus = 11e9
poisson_ratio = 0.44
[contacts.D6-steel]
restitution = 0.42
[effects.air_drag]
drag_coefficient = 0.47
"""


def table() -> str:
    """A bead that falls from 0.2 m and rebounds, over time."""
    rows, height, speed = ["time_s,x_m,y_m"], 0.2, 0.0
    for k in range(160):
        rows.append(f"{k / 240:.6f},0.0,{height:.6f}")
        speed -= 9.81 / 240
        height += speed / 240
        if height < 0:
            height, speed = -height, -0.6 * speed
    return "\n".join(rows) + "\n"


def notes() -> str:
    condition = {"name": "one", "wall": "steel", "particle": "D6", "repetitions": 6, "files": "r%02d.csv"}
    bead = {"diameter_m": 0.006, "mass_g": 0.064}
    camera = {"frame_rate_hz": 240, "scale_m_per_px": 2e-4, "tracking_noise_px": 0.2}
    return json.dumps(
        {
            "rig": "drop",
            "camera": camera,
            "particles": {"D6": bead},
            "conditions": [{**condition, "drop_height_m": 0.2}],
        }
    )


def in_bytes(chance: random.Random, whole: bytes) -> bytes:
    """Some bytes changed, cut out, doubled or cut off."""
    data = bytearray(whole)
    for _ in range(chance.choice((1, 1, 3, 20))):
        place = chance.randrange(max(1, len(data)))
        if chance.random() < 0.3:  # headers decide the most
            place = min(place, chance.randrange(512))
        end = place + chance.choice((1, 4, 200))
        kind = chance.randrange(5)
        if kind == 0:
            data[place:end] = chance.randbytes(end - place)
        elif kind == 1 and data:
            data[place % len(data)] ^= 1 << chance.randrange(8)
        elif kind == 2:
            del data[place:end]
        elif kind == 3:
            data[place:place] = data[place:end]
        elif chance.random() < 0.3:
            del data[place:]
    return bytes(data)


def in_words(chance: random.Random, text: str) -> bytes:
    """Some numbers or words exchanged, lines left out or doubled; at times bytes."""
    for _ in range(chance.choice((1, 1, 1, 2, 5))):
        found = list(re.finditer(r"-?\d+(?:\.\d+)?(?:e-?\d+)?|\w+|\n", text))
        if not found:
            break
        one = chance.choice(found)
        kind = chance.randrange(4)
        scaled = f"{10 ** chance.uniform(-3, 3):.3g}"
        put = (chance.choice((*EXTREMES, scaled, scaled)), chance.choice(found)[0], "", 2 * one[0])[kind]
        text = text[: one.start()] + put + text[one.end() :]
    data = text.encode("utf-8", "surrogatepass")
    return in_bytes(chance, data) if chance.random() < 0.2 else data


def case(number: int, folder: Path) -> tuple[str, list[str]]:
    """Write the files of a case; its kind and the command."""
    chance = random.Random(f"{SEED} {number}")
    out = ["--out", str(folder / "out")]
    kinds: dict[str, Callable[[], list[str]]] = {}

    def written(name: str, data: bytes) -> str:
        (folder / name).write_bytes(data)
        return str(folder / name)

    def lab_toml() -> list[str]:
        written("r01.csv", table().encode())
        written("lab.toml", in_words(chance, LAB))
        return ["compare", str(folder), *out]

    def lab_json() -> list[str]:
        for k in range(1, 7):
            written(f"r0{k}.csv", table().replace(",0.0,", f",{1e-4 * k},").encode())
        written("lab.json", in_words(chance, notes()))
        return ["diagnose", str(folder), *out]

    def csv() -> list[str]:
        return ["measure", "drop", written("r01.csv", in_words(chance, table())), *out]

    def model() -> list[str]:
        written("r01.csv", table().encode())
        written("lab.toml", LAB.encode())
        return ["compare", str(folder), "--model", written("model.toml", in_words(chance, MODEL)), *out]

    def photo() -> list[str]:
        data = in_bytes(chance, (SAMPLES / "pile" / "view1.jpg").read_bytes())
        return ["measure", "pile", written("view.jpg", data), "--base-diameter", "90mm", *out]

    def film() -> list[str]:
        data = in_bytes(chance, (SAMPLES / "drop" / "r01.mp4").read_bytes())
        return ["measure", "drop", written("r01.mp4", data), "--bead-diameter", "6mm", *out]

    def options() -> list[str]:
        words = ["--drop-height", "200mm", "--restitution", "0.5", "--frame-rate", "240Hz", "--bounces", "3"]
        for _ in range(chance.choice((1, 2))):
            place = chance.choice((1, 3, 5, 7)) if chance.random() < 0.9 else chance.randrange(len(words))
            unit = (
                re.sub(r"[\d.]+", "", words[place]) if chance.random() < 0.8 else chance.choice(("mm", "Hz", "deg", ""))
            )
            number = f"{10 ** chance.uniform(-6, 6):.3g}" if chance.random() < 0.6 else chance.choice(EXTREMES)
            words[place] = number + unit
        return ["simulate", "drop", *words, *out]

    kinds = {
        "lab.toml": lab_toml, "lab.json": lab_json, "table": csv, "model.toml": model, "photo": photo, "film": film,
        "options": options,
    }  # fmt: skip
    kind = list(kinds)[number % len(kinds)]
    return kind, kinds[kind]()


def run_cases(first: int) -> int:
    """Run the cases from `first` on, with one line of JSON before and after each."""
    from rigtwin.cli import run

    said = sys.stdout
    for number in range(first, COUNT):
        with tempfile.TemporaryDirectory(prefix="rigtwin-fuzz-") as name:
            kind, command = case(number, Path(name))
            said.write(json.dumps({"begun": number, "kind": kind}) + "\n")
            said.flush()
            errors, began = io.StringIO(), time.monotonic()
            with contextlib.redirect_stderr(errors), contextlib.redirect_stdout(io.StringIO()):
                code = run([*command, "--quiet"])
            seconds = time.monotonic() - began
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1000
        text = errors.getvalue().strip()
        line = {"ended": number, "kind": kind, "code": code, "seconds": seconds, "peak_mb": peak, "said": text[-300:]}
        listed = re.match(r"rigtwin: .* has (\d+) faults:\n", text)  # of a lab.toml, on a line each
        line["sentences"] = text.count("\n") + 1 - (int(listed[1]) if listed else 0)
        said.write(json.dumps(line) + "\n")
        said.flush()
    return 0


def judged() -> tuple[list[dict[str, object]], list[str], list[str]]:
    """All cases that ended, and the cases at which the process died or hung."""
    done: list[dict[str, object]] = []
    died: list[str] = []
    hung: list[str] = []
    following = 0
    while following < COUNT:
        words = [sys.executable, str(Path(__file__).resolve()), "--from", str(following)]
        with subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as child:
            assert child.stdout is not None
            kind, stopped = "", threading.Event()
            guard = _guard(child, 3 * LONGEST, stopped)  # the first case imports all libraries
            for line in child.stdout:
                guard.cancel()
                if not line.startswith("{"):
                    continue
                entry = json.loads(line)
                guard = _guard(child, 3 * LONGEST if not done else LONGEST, stopped)
                if "begun" in entry:
                    following, kind = entry["begun"] + 1, entry["kind"]
                else:
                    done.append(entry)
            guard.cancel()
        if child.returncode == 0:
            break
        (hung if stopped.is_set() else died).append(f"case {following - 1}, {kind}")
    return done, died, hung


def _guard(child: subprocess.Popen[str], seconds: float, stopped: threading.Event) -> threading.Timer:
    def stop() -> None:
        stopped.set()
        child.kill()

    timer = threading.Timer(seconds, stop)
    timer.daemon = True
    timer.start()
    return timer


def main() -> int:
    if sys.argv[1:2] == ["--from"]:
        return run_cases(int(sys.argv[2]))
    done, died, hung = judged()
    faults = [entry for entry in done if entry["code"] not in (0, 2)]
    long = [entry for entry in done if entry["code"] == 2 and entry["sentences"] != 1]
    peak = max((float(str(entry["peak_mb"])) for entry in done), default=0.0)
    ends = Counter(f"{entry['kind']}, exit {entry['code']}" for entry in done)

    def none_of(name: str, found: list[str]) -> Row:
        return Row(name, float(len(found)), "1", 0.0, f"0 of {COUNT}", not found, "; ".join(found[:3]))

    rows = [
        none_of("a fault of rigtwin", [f"case {e['ended']}, {e['kind']}: {str(e['said'])[-140:]}" for e in faults]),
        none_of("the process died", died),
        none_of("the process hung", hung),
        none_of("refused in more than a sentence or a list", [f"case {e['ended']}, {e['kind']}" for e in long]),
        Row("largest memory", peak, "MB", None, f"below {MEMORY:g}", peak < MEMORY),
        *(Row(name, float(number)) for name, number in sorted(ends.items())),
    ]
    return report("fuzz", rows, seed=SEED, count=COUNT)


if __name__ == "__main__":
    sys.exit(main())
