"""Damaged films, stacks, high-speed recordings, photos and sounds."""

from __future__ import annotations

import io
from functools import cache
from pathlib import Path
from random import Random

import cv2

from rigtwin.benchmarks.fuzz_cases import films
from rigtwin.benchmarks.fuzz_cases.case import Case, out, written
from rigtwin.benchmarks.fuzz_cases.mutations import in_bytes, in_words

SAMPLES = Path(__file__).resolve().parents[2] / "sample_media"
DROP = ("--frame-rate", "240Hz", "--bead-diameter", "6mm")


def container(chance: Random, folder: Path) -> Case:
    """A film of twelve small pictures in any container and codec."""
    name = chance.choice(list(films.films()))
    path = written(folder, name, in_bytes(chance, films.films()[name]))
    return Case(["measure", "drop", path, *DROP, *out(folder)])


def long_film(chance: Random, folder: Path) -> Case:
    """A film that is measured to the end."""
    how = chance.choice((("mp4", "libx264", "yuv420p"), ("avi", "mjpeg", "yuvj420p"), ("mkv", "ffv1", "yuv420p")))
    path = written(folder, f"r01.{how[0]}", in_bytes(chance, films.film(*how, 48, 160, 60)))
    return Case(["measure", "drop", path, *DROP, *out(folder)])


def stack(chance: Random, folder: Path) -> Case:
    """A TIFF stack, a folder of pictures, or a high-speed recording with its header."""
    kind = chance.randrange(4)
    if kind < 2:
        name = chance.choice(list(films.stacks()))
        path = written(folder, name, in_bytes(chance, films.stacks()[name]))
    elif kind == 2:
        ending = chance.choice((".png", ".jpg", ".bmp", ".tif"))
        damaged = chance.randrange(4)
        for k in range(4):
            data = films.still(ending, k)
            written(folder, f"clip/p{k:02d}{ending}", in_bytes(chance, data) if k == damaged else data)
        path = str(folder / "clip")
    else:
        name, text = chance.choice(list(films.headers().items()))
        path = written(folder, name, in_words(chance, text))
        raw = films.raw_pictures()
        written(folder, "fast.mraw", raw if chance.random() < 0.7 else raw[: chance.randrange(len(raw))])
    return Case(["measure", "drop", path, *DROP, *out(folder)])


@cache
def heap(ending: str) -> bytes:
    """A small photo of a heap."""
    if ending == ".heic":
        return _heic()
    return bytes(cv2.imencode(ending, _small_heap())[1].tobytes())


def _small_heap() -> cv2.typing.MatLike:
    picture = cv2.imread(str(SAMPLES / "pile" / "view1.jpg"))
    assert picture is not None
    return cv2.resize(picture, None, fx=0.4, fy=0.4, interpolation=cv2.INTER_AREA)


def _heic() -> bytes:
    import pillow_heif
    from PIL import Image

    kept = io.BytesIO()
    pillow_heif.register_heif_opener()
    Image.fromarray(cv2.cvtColor(_small_heap(), cv2.COLOR_BGR2RGB)).save(kept, format="HEIF")
    return kept.getvalue()


def photo(chance: Random, folder: Path) -> Case:
    """A photo of a heap."""
    ending = chance.choice((".jpg", ".jpg", ".png", ".bmp", ".tif", ".webp", ".heic"))
    path = written(folder, f"view{ending}", in_bytes(chance, heap(ending)))
    return Case(["measure", "pile", path, "--base-diameter", "90mm", *out(folder)])


def sound(chance: Random, folder: Path) -> Case:
    """A sound recording of impacts."""
    name = chance.choice(list(films.sounds()))
    path = written(folder, name, in_bytes(chance, films.sounds()[name]))
    return Case(["measure", "drop", path, *out(folder)])
