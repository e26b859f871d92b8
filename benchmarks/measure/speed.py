"""What measuring costs in CPU time: a long clip beside reading it with OpenCV, and a large photo."""

from __future__ import annotations

import json
import math
import subprocess
import sys
import tempfile
from pathlib import Path

import av
import cv2
import numpy as np
import numpy.typing as npt

from rigtwin.benchmarks.figures import Row, below, small
from rigtwin.lab.rigs import GRAVITY

Array = npt.NDArray[np.float64]

RATE, SECONDS = 240, small(10, 1)
WIDTH, HEIGHT = small(1920, 320), small(1080, 480)
SCALE, RADIUS, FLOOR = 0.3e-3, 14.0, small(1000.0, 440.0)  # [m/px], [px], [px]
DROP, RESTITUTION = small(0.27, 0.1), 0.7  # [m], [1]
PHOTO = small((4000, 3000), (800, 600))  # [px]
SAMPLE = Path(__file__).resolve().parents[2] / "sample_media" / "pile" / "view1.jpg"

# run in a process of its own, so that neither memory nor threads of the one before count
READ = """
import json, sys, time
import cv2
began, clip = time.process_time(), cv2.VideoCapture(sys.argv[1])
while clip.read()[0]:
    pass
print(json.dumps({"cpu_s": time.process_time() - began}))
"""
MEASURE = """
import json, sys, time
from pathlib import Path
from rigtwin.lab.camera import Camera
from rigtwin.measure.drop import measurement as drop
from rigtwin.measure.pile import measurement as pile
import matplotlib.figure, scipy.ndimage, scipy.spatial, scipy.sparse.csgraph
kind, media, out = sys.argv[1], Path(sys.argv[2]), Path(sys.argv[3]) if sys.argv[3:] else None
began = time.process_time()
if kind == "drop":
    found = drop.measure(media, Camera(frame_rate=240.0, scale=0.3e-3), out=out)
else:
    found = pile.measure([media], Camera(), base_diameter=0.09, bead_diameter=0.0062, out=out)
spent = time.process_time() - began
# of this program alone: ru_maxrss counts what the benchmark held when it began this process
peak = next(line for line in Path("/proc/self/status").read_text().splitlines() if line.startswith("VmHWM"))
print(json.dumps({
    "cpu_s": spent,
    "peak_mb": int(peak.split()[1]) / 1024,
    "first": found.quantities[1 if kind == "drop" else 0].value,
}))
"""


def speed(_: int) -> list[Row]:
    """CPU time of a 10 s clip of 1920 x 1080 px at 240 Hz, and of a photo of 12 megapixels."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        clip, photo = folder / "long.mp4", folder / "heap.jpg"
        draw_clip(clip)
        cv2.imwrite(str(photo), cv2.resize(cv2.imread(str(SAMPLE)), PHOTO, interpolation=cv2.INTER_CUBIC))
        reading = _in_process(READ, str(clip))["cpu_s"]
        bare, drawn = (_in_process(MEASURE, "drop", str(clip), *more) for more in ([], [name]))
        heap, heap_drawn = (_in_process(MEASURE, "pile", str(photo), *more) for more in ([], [name]))
    note = f"{bare['cpu_s']:.1f} s, reading {reading:.1f} s; restitution {bare['first']:.4f} ({RESTITUTION})"
    photo_size = f"{PHOTO[0] * PHOTO[1] / 1e6:g}"
    title = f"{SECONDS} s clip, {WIDTH} x {HEIGHT} px, {RATE} Hz"
    return [
        below(f"{title}: CPU time over that of cv2 reading it", bare["cpu_s"] / reading, 1.25, note=note),
        Row(f"{title}: likewise with overlay and plot", drawn["cpu_s"] / reading, note=f"{drawn['cpu_s']:.1f} s"),
        below(f"{title}: peak memory", drawn["peak_mb"], 400, unit="MB"),
        below(
            f"{photo_size}-megapixel photo of a heap: CPU time",
            heap["cpu_s"],
            1.0,
            unit="s",
            note="both angles of repose",
        ),
        Row(f"{photo_size}-megapixel photo of a heap: likewise with overlay and plot", heap_drawn["cpu_s"], "s"),
    ]


def draw_clip(path: Path, seconds: float = SECONDS) -> None:
    """A lit bead that falls after two seconds and bounces to rest, before a grainy wall; about 25 Mbit/s."""
    rng = np.random.default_rng(1)
    coarse = cv2.resize(
        rng.normal(0, 14, (34, WIDTH // 32)).astype(np.float32), (WIDTH, HEIGHT), interpolation=cv2.INTER_CUBIC
    )
    wall = cv2.GaussianBlur(118 + coarse + rng.normal(0, 4, coarse.shape), (0, 0), 1.2)
    wall[int(FLOOR) :] = 70 + 0.3 * wall[int(FLOOR) :]
    grain = [np.clip(np.round(wall + rng.normal(0, 2.5, wall.shape)), 0, 255).astype(np.uint8) for _ in range(12)]
    time = (np.arange(round(seconds * RATE)) + 0.15) / RATE
    heights = _heights(time, 0.2 * seconds)
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=RATE, options={"preset": "superfast", "crf": "20"})
        stream.width, stream.height, stream.pix_fmt = WIDTH, HEIGHT, "yuv420p"
        for k, height in enumerate(heights):
            blur = 0.3 * float(heights[min(k + 1, len(heights) - 1)] - heights[max(k - 1, 0)]) / (2 * SCALE)
            picture = grain[k % len(grain)].copy()
            _draw_bead(picture, WIDTH / 2 + 0.3, FLOOR - RADIUS - float(height) / SCALE, blur)
            frame = av.VideoFrame.from_ndarray(picture, format="gray").reformat(format="yuv420p")
            for packet in stream.encode(frame):
                container.mux(packet)
        for packet in stream.encode():
            container.mux(packet)


def _draw_bead(picture: npt.NDArray[np.uint8], x: float, y: float, blur: float) -> None:
    reach = math.ceil(RADIUS + abs(blur) / 2) + 3
    left, top = int(x) - reach, max(int(y) - reach, 0)
    window = np.s_[top : int(y) + reach + 1, left : left + 2 * reach + 1]
    rows, columns = np.mgrid[window].astype(np.float64)
    cover, light = np.zeros(rows.shape), np.zeros(rows.shape)
    for part in (np.arange(7) + 0.5) / 7 - 0.5:
        u, v = (columns - x) / RADIUS, (rows - y + part * blur) / RADIUS
        inside = np.clip(RADIUS * (1 - np.hypot(u, v)) + 0.5, 0, 1) / 7
        cover += inside
        light += inside * (205 - 35 * u - 30 * v - 25 * (u * u + v * v))
    picture[window] = np.clip(np.round(picture[window] * (1 - cover) + light), 0, 255)


def _heights(time: Array, release: float) -> Array:
    """[m], flight by flight, without air."""
    speed = math.sqrt(2 * GRAVITY * DROP)
    heights = np.where(time < release, DROP, DROP - GRAVITY / 2 * (time - release) ** 2)
    hit = release + speed / GRAVITY
    while speed > 0.05:
        speed *= RESTITUTION
        since = time - hit
        heights = np.where(since > 0, speed * since - GRAVITY / 2 * since**2, heights)
        hit += 2 * speed / GRAVITY
    return np.where(time > hit, 0.0, heights)


def _in_process(program: str, *arguments: str) -> dict[str, float]:
    done = subprocess.run([sys.executable, "-c", program, *arguments], capture_output=True, text=True, check=True)
    found: dict[str, float] = json.loads(done.stdout.splitlines()[-1])
    return found
