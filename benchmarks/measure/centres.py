"""The centre of a bead that is followed through a film, beside other methods and the Cramer-Rao bound.

A bead crosses a film of noise, straight and evenly; rigtwin follows it as `rigtwin measure` does, with nothing given:
it learns the scene, the bead's radius, edge and light, and the exposure from the film.  The other methods see the
pixels around the true place in each frame, and those that need the radius are given it.

The bound is that of one frame in which all but the centre is known: radius, edge, blur, the light on the bead, the
background; its noise is white, that of the camera and of rounding to whole grey levels together.  Radius, edge,
contrast and blur would cost nothing more if unknown, for they change a bead alike on both sides; but light that is
brighter on one side does: a bead of radius 5 px is located 1.4 times worse from a single frame whose light is unknown.
`locate` sees single frames and knows no light, so it is held against that bound.  Of a film that a codec has
compressed no bound is known: that of the film before is given.
"""

from __future__ import annotations

import importlib.util
import math
import tempfile
from collections.abc import Callable
from pathlib import Path

import av
import cv2
import numpy as np
import numpy.typing as npt

from rigtwin.benchmarks.figures import Row, against, below, skipped, small
from rigtwin.lab.camera import Camera
from rigtwin.measure.media.video import open_video
from rigtwin.measure.scene.background import learn_scene
from rigtwin.measure.tracking.cutouts import Sighting
from rigtwin.measure.tracking.find_paths import find_paths
from rigtwin.measure.tracking.follow import chase_path
from rigtwin.measure.tracking.refine import locate

Array = npt.NDArray[np.float64]
Grey = npt.NDArray[np.uint8]
Centre = tuple[float, float] | None

FILMS = small(5, 1)  # of each compressed case: a codec's error of a whole film is one draw
TRACKPY = importlib.util.find_spec("trackpy") is not None
FINE = small(4, 2)  # pictures are drawn on a grid this much finer
LENS = 0.7  # [px]
CONTRAST, GROUND = 120.0, 60.0  # [grey levels]
DISCS = (  # radius [px], blur [px], signal to noise, shading across the bead's surroundings [grey levels], H.264 crf
    (5.0, 0.0, 20.0, 0.0, None),
    (12.0, 0.0, 5.0, 0.0, None),
    (12.0, 0.0, 20.0, 0.0, None),
    (12.0, 0.0, 50.0, 0.0, None),
    (12.0, 0.0, 20.0, 40.0, None),
    (30.0, 0.0, 20.0, 0.0, None),
    (12.0, 8.0, 20.0, 0.0, None),
    (25.0, 20.0, 20.0, 0.0, None),
    (12.0, 0.0, 20.0, 0.0, 18),
    (12.0, 0.0, 20.0, 0.0, 28),
    (12.0, 8.0, 20.0, 0.0, 23),
)


def draw(
    centre: Array, radius: float, blur: float, size: int, shading: float = 0.0, slopes: tuple[float, float] = (0.0, 0.0)
) -> Array:
    """A disc smeared downwards by `blur` [px] before a shaded ground, through a lens, without noise.

    `slopes` [grey levels per radius] make it brighter to the right and below.
    """
    fine = (np.arange(size * FINE) + 0.5) / FINE - 0.5
    x, y = fine[None] - centre[0], fine[:, None] - centre[1]
    steps = max(1, round(2 * blur))
    light = np.zeros((len(fine), len(fine)))
    for k in range(steps):
        down = y - ((k + 0.5) / steps - 0.5) * blur
        cover = np.clip((radius - np.hypot(x, down)) * FINE + 0.5, 0, 1)
        light += cover if slopes == (0, 0) else cover * (1 + (slopes[0] * x + slopes[1] * down) / (radius * CONTRAST))
    # the lens comes before the pixels
    through = cv2.GaussianBlur(light / steps, (0, 0), LENS * FINE)
    seen = through.reshape(size, FINE, size, FINE).mean(axis=(1, 3))
    ground = GROUND + shading * (np.arange(size) / size - 0.5)[None]
    return np.asarray(ground + CONTRAST * seen)


def bound(radius: float, blur: float, size: int, noise: float, *, light_known: bool = True) -> Array:
    """Cramer-Rao bound of x and y [px], of one frame; see above for what is known."""
    middle, step = np.array([size / 2 + 0.2, size / 2 + 0.3]), 0.25
    rows = [
        draw(middle + move, radius, blur, size) - draw(middle - move, radius, blur, size) for move in np.eye(2) * step
    ]
    if not light_known:
        rows += [
            draw(middle, radius, blur, size, slopes=(step, 0)) - draw(middle, radius, blur, size, slopes=(-step, 0)),
            draw(middle, radius, blur, size, slopes=(0, step)) - draw(middle, radius, blur, size, slopes=(0, -step)),
            draw(middle, radius + step, blur, size) - draw(middle, radius - step, blur, size),
            2 * step * (draw(middle, radius, blur, size) - GROUND),
            np.full((size, size), 2 * step),
        ]
    change = np.array(rows).reshape(len(rows), -1) / (2 * step * noise)
    return np.asarray(np.sqrt(np.diag(np.linalg.inv(change @ change.T)))[:2])


def by_hough(grey: Grey, radius: float) -> Centre:
    low, high = max(round(0.7 * radius), 2), round(1.4 * radius) + 1
    found = cv2.HoughCircles(grey, cv2.HOUGH_GRADIENT, 1, 20, param1=100, param2=10, minRadius=low, maxRadius=high)
    if found is None:
        return None
    x, y, _ = found.reshape(-1, 3)[0]
    return float(x), float(y)


def by_otsu(grey: Grey, _: float) -> Centre:
    _, mask = cv2.threshold(grey, 0, 255, cv2.THRESH_BINARY + cv2.THRESH_OTSU)
    outlines, _ = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    m = cv2.moments(max(outlines, key=cv2.contourArea))
    return (m["m10"] / m["m00"], m["m01"] / m["m00"]) if m["m00"] else None


def by_contour(grey: Grey, _: float) -> Centre:
    """Sub-pixel contour at half height and its area's centroid."""
    from skimage.measure import find_contours

    smooth = cv2.GaussianBlur(grey.astype(np.float64), (0, 0), 1.0)
    outlines = find_contours(smooth, (np.percentile(smooth, 2) + np.percentile(smooth, 99)) / 2)
    if not outlines:
        return None
    y, x = max(outlines, key=len).T
    cross = x[:-1] * y[1:] - x[1:] * y[:-1]
    area = cross.sum() / 2
    if abs(area) < 1:
        return None
    return float(((x[:-1] + x[1:]) * cross).sum() / (6 * area)), float(((y[:-1] + y[1:]) * cross).sum() / (6 * area))


def by_trackpy(grey: Grey, radius: float) -> Centre:
    """trackpy's band pass and centroid of light, in a window a little wider than the bead."""
    import trackpy

    found = trackpy.locate(grey, 2 * math.ceil(radius) + 3, max_iterations=50, topn=1, engine="python")
    return (float(found.x.iloc[0]), float(found.y.iloc[0])) if len(found) else None


def by_template(grey: Grey, radius: float) -> Centre:
    """Correlation with a sharp ideal disc, and a parabola through its peak."""
    side = 2 * math.ceil(radius + 4) + 1
    ideal = draw(np.array([side // 2, side // 2]), radius, 0, side, 0).astype(np.float32)
    score = cv2.matchTemplate(grey.astype(np.float32), ideal, cv2.TM_CCOEFF_NORMED)
    row, column = np.unravel_index(int(np.argmax(score)), score.shape)
    if not (0 < row < score.shape[0] - 1 and 0 < column < score.shape[1] - 1):
        return None
    cut = score[row - 1 : row + 2, column - 1 : column + 2]
    x, y = (_peak(*line) for line in (cut[1], cut[:, 1]))
    return float(column + x + side // 2), float(row + y + side // 2)


def _peak(before: float, at: float, after: float) -> float:
    bend = before - 2 * at + after
    return float((before - after) / (2 * bend)) if bend else 0.0


OTHERS: dict[str, Callable[[Grey, float], Centre]] = {
    "trackpy": by_trackpy,
    "sub-pixel contour": by_contour,
    "template": by_template,
    "Otsu and moments": by_otsu,
    "Hough": by_hough,
}


def film(
    path: Path,
    rng: np.random.Generator,
    radius: float,
    blur: float,
    noise: float,
    shading: float,
    crf: int | None,
    count: int,
) -> tuple[Array, int]:
    """Draw a film, lossless without `crf`; the true centres [px], shape (count, 2), and the size around them."""
    size, way = 2 * round(1.9 * radius + blur / 2 + 12), np.array([0.13, max(small(3.1, radius), 1.27 * blur)])
    width, height = (2 * math.ceil((size + along * count) / 2) for along in way)
    centres = size / 2 + rng.uniform(-1, 1, 2) + way * np.arange(count)[:, None]
    empty = np.tile(draw(np.full(2, -999.0), 1, 0, width, shading)[:1], (height, 1))
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=240, options={"qp": "0"} if crf is None else {"crf": str(crf)})
        stream.width, stream.height, stream.pix_fmt = width, height, "yuvj420p"
        for centre in centres:
            corner = _corner(centre, size, empty.shape)
            window = np.s_[corner[1] : corner[1] + size, corner[0] : corner[0] + size]
            picture = empty + rng.normal(0, noise, empty.shape)
            picture[window] += draw(centre - corner, radius, blur, size) - GROUND
            grey = np.clip(np.round(picture), 0, 255).astype(np.uint8)
            for packet in stream.encode(av.VideoFrame.from_ndarray(grey, format="gray").reformat(format="yuvj420p")):
                container.mux(packet)
        for packet in stream.encode():
            container.mux(packet)
    return centres, size


def _corner(centre: Array, size: int, shape: tuple[int, ...]) -> npt.NDArray[np.intp]:
    """Left and top of a square of `size` about a centre, inside the picture."""
    return np.clip(np.round(centre - size / 2).astype(int), 0, [shape[1] - size, shape[0] - size])


def follow(path: Path) -> dict[int, Sighting]:
    """The bead in every frame in which it is seen."""
    video = open_video(path, Camera(frame_rate=240.0))
    moves = find_paths(video, learn_scene(video).scene(), None)
    longest = max(moves.paths, key=lambda each: len(each.frames), default=None)
    return {} if longest is None else {each.frame: each for each in chase_path(video, longest, moves).sightings}


def centres(count: int, seed: int) -> list[Row]:
    """Root mean square error of the centre, in multiples of the bound, and whether the stated sigma matches it."""
    rows, count = [], small(count, 16)  # of fewer frames no bead is followed
    others = {name: method for name, method in OTHERS.items() if name != "trackpy" or TRACKPY}
    for radius, blur, snr, shading, crf in DISCS:
        rng, noise = np.random.default_rng(seed), CONTRAST / snr
        errors: dict[str, list[Array]] = {name: [] for name in ("one frame alone", *others)}
        off, sigma, films = np.empty((0, 2)), np.empty((0, 1)), FILMS if crf else 1
        for _ in range(films):
            with tempfile.TemporaryDirectory() as folder:
                path = Path(folder) / "bead.mp4"
                truth, size = film(path, rng, radius, blur, noise, shading, crf, count)
                followed = follow(path)
                frames = {frame.index: frame.grey for frame in open_video(path, Camera(frame_rate=240.0)).frames()}
            missed = [np.array(each.place) - truth[index] for index, each in followed.items()]
            off = np.vstack([off, *missed])
            sigma = np.vstack([sigma, *([each.image.sigma] for each in followed.values())])
            ground = np.tile(draw(np.full(2, -999.0), 1, 0, frames[0].shape[1], shading)[:1], (frames[0].shape[0], 1))
            for index, centre in enumerate(truth):
                corner = _corner(centre, size, ground.shape)
                window = np.s_[corner[1] : corner[1] + size, corner[0] : corner[0] + size]
                grey, there = frames[index][window], centre - corner
                near = there + rng.uniform(-1, 1, 2)
                alone = locate(grey, ground[window], (float(near[0]), float(near[1])), radius)
                if alone is not None:
                    errors["one frame alone"].append(np.array([alone.x, alone.y]) - there)
                for name, method in others.items():
                    other = method(grey, radius)
                    if other is not None and math.dist(other, there) < radius:
                        errors[name].append(np.array(other) - there)
        case = f"R {radius:g}, blur {blur:g}, SNR {snr:g}, shading {shading:g}" + (f", crf {crf}" if crf else "")
        limit, rounded = 1.2 if blur else 1.15, math.hypot(noise, 1 / math.sqrt(12))
        best, best_alone = (bound(radius, blur, size, rounded, light_known=known) for known in (True, False))
        drawn = count * films
        lost = f"{drawn - len(off)} of {drawn} lost"
        ratio = float(np.sqrt(np.mean((off / best) ** 2))) if len(off) == drawn else math.inf
        note = f"bound {best[0]:.4f} / {best[1]:.4f} px; {lost}"
        title = f"{case}: ours, rms / bound"
        rows.append(Row(title, ratio, note=note) if crf else below(title, ratio, limit, note=note))
        for name, each in errors.items():
            own, lost = best_alone if name == "one frame alone" else best, f"{drawn - len(each)} of {drawn} lost"
            ratio = float(np.sqrt(np.mean((np.array(each) / own) ** 2))) if each else math.inf
            row = Row(f"{case}: {name}, rms / bound", ratio, note=lost)
            if own is best_alone and not crf:
                note = f"bound with unknown light {own[0]:.4f} / {own[1]:.4f} px; {lost}"
                row = below(row.name, ratio, limit, note=note)
            rows.append(row)
        if not TRACKPY:
            rows.append(
                skipped(f"{case}: trackpy, rms / bound", "trackpy is not installed; it is in the group `bench`")
            )
        pull = float(np.sqrt(np.mean((off / sigma) ** 2))) if len(off) else math.inf
        rows.append(against(f"{case}: rms of error / sigma", pull, 1, relative=0.15))
    return rows
