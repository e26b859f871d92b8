"""Tables of tracked data: our own CSV, and what tracking programs export."""

from __future__ import annotations

import io
import math
from functools import cache
from pathlib import Path
from random import Random

from rigtwin.benchmarks.fuzz_cases.case import Case, out, written
from rigtwin.benchmarks.fuzz_cases.mutations import EXTREMES, in_bytes, in_words
from rigtwin.benchmarks.fuzz_cases.reference import same_track

RATE, ROWS = 240, 70  # [1/s]; pictures of a fall and two rebounds
SCALE = 2e-4  # [m/px]
TRACKER = """<?xml version="1.0"?><object class="org.opensourcephysics.cabrillo.tracker.TrackerPanel">
<property name="clipcontrol" type="object"><object class="a.StepperClipControl">
<property name="delta_t" type="double">{}</property></object></property>
<property name="coords" type="object"><object class="a.ImageCoordSystem">
<property name="framedata" type="array"><property name="[0]" type="object"><object class="a.FrameData">
<property name="xorigin" type="double">0.0</property><property name="yorigin" type="double">1000.0</property>
<property name="angle" type="double">0.0</property>
<property name="xscale" type="double">5000.0</property><property name="yscale" type="double">5000.0</property>
</object></property></property></object></property>
<property name="tracks" type="collection"><property name="item" type="object"><object class="a.PointMass">
<property name="name" type="string">ball</property><property name="framedata" type="array">
{}</property></object></property></property></object>"""
MARK = (
    '<property name="[{}]" type="object"><object class="a.FrameData"><property name="x" type="double">{:.2f}</property>'
    '<property name="y" type="double">{:.2f}</property></object></property>\n'
)


def fall(rows: int = ROWS) -> list[tuple[float, float]]:
    """Time [s] and height [m] of a bead that falls from 0.05 m and rebounds with 0.7 of its speed."""
    height, gravity, restitution, found = 0.05, 9.81, 0.7, []
    landing = math.sqrt(2 * height / gravity)
    speed = restitution * gravity * landing
    for k in range(rows):
        time = k / RATE
        if time <= math.sqrt(2 * height / gravity):
            found.append((time, height - gravity * time**2 / 2))
            continue
        while time > landing + 2 * speed / gravity:
            landing, speed = landing + 2 * speed / gravity, restitution * speed
        found.append((time, speed * (time - landing) - gravity * (time - landing) ** 2 / 2))
    return found


@cache
def table(x: float = 0.0, rows: int = ROWS) -> str:
    """The fall as a table of rigtwin, with the bead at `x` [m]."""
    return "time_s,x_m,y_m\n" + "".join(f"{time:.6f},{x},{height:.6f}\n" for time, height in fall(rows))


@cache
def exports() -> dict[str, str]:
    """The fall as tracking programs export it, by the name of a file."""
    pixels = [(k, 100.0, 600 - height / SCALE) for k, (_, height) in enumerate(fall())]
    spots = "LABEL,ID,TRACK_ID,QUALITY,POSITION_X,POSITION_Y,POSITION_T,FRAME\n,,,,(pixel),(pixel),(sec),\n"
    trackpy = ",y,x,mass,size,ecc,signal,raw_mass,ep,frame,particle\n"
    tracks = '<Tracks nTracks="1" spaceUnits="pixel" frameInterval="{}" timeUnits="sec">\n<particle nSpots="{}">\n'
    plain = "".join(f"{time:.5f}\t0.0\t{height:.5f}\n" for time, height in fall())
    vernier = "Vernier Format 2\ndrop.cmbl 5/5/2024 9:37\nData Set\nTime\tX\tY\nt\tx\ty\ns\tm\tm\n\n"
    return {
        "tracker.txt": "ball\nt\tx\ty\n" + plain,
        "tracker.trk": TRACKER.format(1000 / RATE, "".join(MARK.format(*one) for one in pixels)),
        "logger.txt": vernier + plain,
        "logger.csv": "Latest: Time (s),Latest: X (m),Latest: Y (m)\n" + plain.replace("\t", ","),
        "kinovea.txt": "#Kinovea Trajectory data export\n#T X Y\n\n"
        + "".join(f"0:00:00:{k:02d} {x:.2f} {y:.2f}\n" for k, x, y in pixels),
        "kinovea.csv": '"Time";"Trajectory 1/0/X";"Trajectory 1/0/Y"\n'
        + "".join(f"{1000 * k / RATE:.2f};{x:.2f};{y:.2f}\n".replace(".", ",") for k, x, y in pixels),
        "trackpy.csv": trackpy + "".join(f"{k},{y:.3f},{x},10,2,0.1,1,9,0.1,{k},4\n" for k, x, y in pixels),
        "trackmate.csv": spots + "".join(f"ID{k},{k},0,5,{x},{y:.3f},{k / RATE:.5f},{k}\n" for k, x, y in pixels),
        "trackmate.xml": tracks.format(1 / RATE, ROWS)
        + "".join(f'<detection t="{k}" x="{x}" y="{y:.3f}" z="0.0" />\n' for k, x, y in pixels)
        + "</particle>\n</Tracks>\n",
        "mtrack2.txt": "Frame\tX1\tY1\tFlag1\nTracks 1 to 1\n"
        + "".join(f"{k + 1}\t{x}\t{y:.2f}\t \n" for k, x, y in pixels),
        "imagej.csv": " ,Area,Mean,X,Y,Slice\n" + "".join(f"{k + 1},9,200,{x},{y:.3f},{k + 1}\n" for k, x, y in pixels),
    }


@cache
def parquet() -> bytes:
    """The fall as trackpy's table in a Parquet file."""
    import pandas as pd

    kept = io.BytesIO()
    pd.read_csv(io.StringIO(exports()["trackpy.csv"]), index_col=0).to_parquet(kept)
    return kept.getvalue()


def own_table(chance: Random, folder: Path) -> Case:
    """Our own table; an accepted one is read again by other means."""
    path = written(folder, "r01.csv", in_words(chance, table()))
    return Case(["measure", "drop", path, *out(folder)], lambda document: same_track(Path(path), document))


def tracker(chance: Random, folder: Path) -> Case:
    """A file of a tracking program."""
    stated = ["--frame-rate", f"{RATE}Hz", "--scale", f"{SCALE}m/px"]
    if chance.random() < 0.1:
        path = written(folder, "tracks.parquet", in_bytes(chance, parquet()))
    else:
        name = chance.choice(list(exports()))
        path = written(folder, name, in_words(chance, exports()[name]))
    return Case(["measure", "drop", path, *stated, *out(folder)])


RIGS = {
    "pendulum": ("time_s,x1,y1,x2,y2\n", ["--length", "200mm", "--bead-diameter", "12mm", "--scale", "1mm/px"]),
    "tilt": ("time_s,x_m,y_m\n", ["--variant", "slide", "--bead-diameter", "6mm"]),
    "hopper": ("time_s,mass_g\n", ["--bead-diameter", "6mm"]),
    "drum": ("time_s,angle_deg\n", ["--drum-diameter", "140mm"]),
    "pile": ("x_m,height_m\n", ["--base-diameter", "90mm"]),
    "packing": ("x_m,height_m\n", ["--cylinder-diameter", "65mm", "--total-mass", "212.7g"]),
}


def _swing(time: float) -> str:
    """A bead on a thread of 200 mm that hits another at rest with a restitution of 0.6: x and y of both [mm]."""
    length, pace, highest = 200, 7.0, 0.3  # [mm], [rad/s], [rad]
    struck = time > math.pi / (2 * pace)
    moved = math.sin(pace * time - math.pi / 2) * highest
    angles = (0.2 * moved, 0.8 * moved) if struck else (moved, 0.0)
    places = [(k * 12 + length * math.sin(a), length * (1 - math.cos(a))) for k, a in enumerate(angles)]
    return f"{time:.5f}," + ",".join(f"{value:.3f}" for place in places for value in place)


@cache
def rig_table(rig: str) -> str:
    """A table of another rig."""
    steps = range(60)
    rows = {
        "pendulum": [_swing(k / 120) for k in range(100)],
        "tilt": [
            f"{k / 60:.4f},{0.1 + 1e-4 * max(0, k - 40) ** 2:.5f},{-5e-5 * max(0, k - 40) ** 2:.5f}" for k in steps
        ],
        "hopper": [f"{k / 10:.2f},{min(5.0 * k, 200)}" for k in steps],
        "drum": [f"{k / 10:.2f},{30 + math.sin(k):.2f}" for k in steps],
        "pile": [f"{(k - 30) / 700:.5f},{max(0.0, 0.02 - abs(k - 30) / 1400):.5f}" for k in steps],
        "packing": [f"{(k - 30) / 1000:.5f},{0.1 + 0.002 * math.sin(k):.5f}" for k in steps],
    }[rig]
    return RIGS[rig][0] + "\n".join(rows) + "\n"


def table_of_rig(chance: Random, folder: Path) -> Case:
    """A table of a rig other than the drop."""
    rig = chance.choice(list(RIGS))
    options = list(RIGS[rig][1])
    path = written(folder, "t.csv", in_words(chance, rig_table(rig)))
    if rig == "tilt":
        angles = "time_s,angle_deg\n" + "".join(f"{k / 60:.4f},{k / 2:.2f}\n" for k in range(60))
        options += ["--angle", written(folder, "angle.csv", in_words(chance, angles))]
    return Case(["measure", rig, path, *options, *out(folder)])


def columns(chance: Random, folder: Path) -> Case:
    """The option that names the columns of a table, and the one that joins its tracks."""
    path = written(folder, "r01.csv", table().replace("time_s,x_m,y_m", "zeit,sp1,sp2"))
    stated = in_words(chance, "t=zeit[s],x=sp1[m],y=sp2[m]").decode(errors="replace").replace("\0", "")
    options = ["--columns", stated]
    if chance.random() < 0.2:
        options += ["--join", chance.choice((*EXTREMES, "1,2", "bead,bead", "bead,bead,")).replace("\0", "")]
    return Case(["measure", "drop", path, *options, *out(folder)])
