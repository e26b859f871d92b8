"""From light to files: lens shading, sensor noise, tone curve, H.264 and JPEG."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import av
import cv2
import numpy as np
import numpy.typing as npt

from rigtwin.sample_media.renderer.scene import Floats

Picture = npt.NDArray[np.uint8]
POINT_SPREAD = 0.55  # [px], standard deviation of the lens and pixel blur in focus


def soften(image: Floats) -> Floats:
    """What the lens makes of a perfectly sharp picture."""
    return cv2.GaussianBlur(image, (0, 0), POINT_SPREAD)


def vignette(width: int, height: int, strength: float) -> Floats:
    """Fall of light towards the corners, shape (height, width, 1)."""
    y, x = np.mgrid[0:height, 0:width]
    r2 = ((x - width * 0.49) ** 2 + (y - height * 0.51) ** 2) / (width**2 + height**2) * 4
    return (1 / (1 + strength * r2) ** 2)[..., None].astype(np.float32)


def develop(light: Floats, exposure: float) -> Floats:
    """Linear light to display values 0..255 through a camera's shoulder and toe."""
    x = np.clip(light * exposure, 0, None)
    x = x * (1 + x / 6.0) / (1 + x)  # a soft shoulder keeps highlights from clipping hard
    x = np.clip(x * 1.55, 0, 1)
    display = np.where(x <= 0.0031308, 12.92 * x, 1.055 * np.power(np.maximum(x, 1e-9), 1 / 2.4) - 0.055)
    return (display * 255).astype(np.float32)


def expose(display: Floats, rng: np.random.Generator, noise: float) -> Picture:
    """Add the sensor's noise (mostly in brightness, more in the shadows) and round to 8 bit."""
    height, width = display.shape[:2]
    luma = rng.standard_normal((height, width), dtype=np.float32)
    chroma = rng.standard_normal((height // 2 + 1, width // 2 + 1, 3), dtype=np.float32)
    chroma = cv2.resize(chroma, (width, height), interpolation=cv2.INTER_LINEAR)
    level = noise * (1.5 - display.mean(axis=2) / 255)
    grainy = display + (luma[..., None] + 0.5 * chroma) * level[..., None]
    return np.clip(grainy + 0.5, 0, 255).astype(np.uint8)


def write_clip(path: Path, frames: Iterable[Picture], rate: int, crf: int) -> None:
    """H.264 in MP4 at its own capture rate; written to a temporary name, then renamed."""
    partial = path.with_name(path.stem + ".part.mp4")
    with av.open(str(partial), "w") as container:
        stream = None
        for frame in frames:
            if stream is None:
                stream = container.add_stream("libx264", rate=rate)
                stream.height, stream.width = frame.shape[:2]
                stream.pix_fmt = "yuv420p"
                # one thread: the same bits on every run
                stream.options = {"crf": str(crf), "preset": "slow", "tune": "grain", "threads": "1"}
            container.mux(stream.encode(av.VideoFrame.from_ndarray(frame, format="rgb24")))
        if stream is not None:
            container.mux(stream.encode(None))
    partial.replace(path)


def write_photo(path: Path, picture: Picture, quality: int) -> None:
    """JPEG of an RGB picture."""
    done, data = cv2.imencode(".jpg", picture[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, quality])
    if not done:
        raise RuntimeError(f"{path}: could not be encoded")
    path.write_bytes(data.tobytes())
