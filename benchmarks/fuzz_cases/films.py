"""Small films of every container and codec, TIFF stacks, high-speed recordings, photos and sounds, made once."""

from __future__ import annotations

import io
import struct
from collections.abc import Callable, Sequence
from fractions import Fraction
from functools import cache, partial
from typing import Any

import av
import cv2
import numpy as np
import tifffile

from rigtwin.benchmarks.fuzz_cases.tables import fall

RATE = 240
WIDE, HIGH, COUNT = 64, 48, 12  # [px], [px] and pictures of a film that is only decoded

CODECS = (
    ("mp4", "libx264", "yuv420p"), ("mp4", "mpeg4", "yuv420p"), ("mp4", "libx265", "yuv420p"),
    ("mp4", "libsvtav1", "yuv420p"), ("mov", "prores_ks", "yuv422p10le"), ("mov", "qtrle", "rgb24"),
    ("mov", "mjpeg", "yuvj420p"), ("mov", "png", "rgb24"), ("avi", "mjpeg", "yuvj420p"),
    ("avi", "huffyuv", "yuv422p"), ("avi", "utvideo", "yuv420p"), ("avi", "rawvideo", "bgr24"),
    ("avi", "cinepak", "rgb24"), ("avi", "mpeg4", "yuv420p"), ("mkv", "libx264", "yuv420p"),
    ("mkv", "ffv1", "yuv420p"), ("mkv", "ffv1", "gray16le"), ("mkv", "rawvideo", "gray"),
    ("webm", "libvpx", "yuv420p"), ("webm", "libvpx-vp9", "yuv420p"), ("wmv", "wmv2", "yuv420p"),
    ("ts", "mpeg2video", "yuv420p"), ("mpg", "mpeg1video", "yuv420p"), ("flv", "flv", "yuv420p"),
    ("gif", "gif", "gray"), ("apng", "apng", "rgb24"), ("y4m", "rawvideo", "yuv420p"),
    ("nut", "ffvhuff", "yuv420p"), ("ivf", "libvpx", "yuv420p"), ("mxf", "mpeg2video", "yuv420p"),
    ("h264", "libx264", "yuv420p"), ("mjpeg", "mjpeg", "yuvj420p"), ("3gp", "mpeg4", "yuv420p"),
)  # fmt: skip
FORMATS = {"mpg": "mpeg", "ts": "mpegts", "y4m": "yuv4mpegpipe", "wmv": "asf", "mkv": "matroska"}
RATES = {"mpeg2video": 25, "mpeg1video": 25, "gif": 50}  # codecs that know few rates

CIH = "#Camera Information Header\nRecord Rate(fps) : 240\nTotal Frame : {}\nImage Width : 64\nImage Height : 48\n"
CIHX = """binary\0 before <cih><recordInfo><recordRate>240</recordRate></recordInfo>
<frameInfo><totalFrame>{}</totalFrame></frameInfo><imageDataInfo><resolution><width>64</width><height>48</height>
</resolution><colorInfo><bit>8</bit></colorInfo><effectiveBit><depth>8</depth></effectiveBit></imageDataInfo></cih>."""


@cache
def pictures(wide: int = WIDE, high: int = HIGH, count: int = COUNT) -> list[Any]:
    """Grey pictures of a bright bead that falls and rebounds before a dark wall."""
    random = np.random.default_rng(1)
    wall = cv2.GaussianBlur(random.uniform(20, 70, (high, wide)).astype(np.float32), (0, 0), 2.0)
    radius, found = max(3, wide // 16), []
    top = max(height for _, height in fall(count))
    for _, height in fall(count):
        picture = wall.copy()
        y = high - 6 - radius - height / top * (high - 12 - 2 * radius)
        cv2.circle(picture, (round(wide / 2 * 16), round(y * 16)), radius * 16, 220.0, -1, cv2.LINE_AA, 4)
        cv2.line(picture, (0, high - 6), (wide, high - 6), 120.0, 1)
        found.append(np.clip(picture, 0, 255).astype(np.uint8))
    return found


@cache
def film(ending: str, codec: str, layout: str, wide: int = WIDE, high: int = HIGH, count: int = COUNT) -> bytes:
    """A film; empty where its encoder is not installed."""
    kept = io.BytesIO()
    try:
        with av.open(kept, "w", format=FORMATS.get(ending, ending)) as container:
            stream = container.add_stream(codec, rate=Fraction(RATES.get(codec, RATE)))
            stream.width, stream.height, stream.pix_fmt = wide, high, layout
            for picture in pictures(wide, high, count):
                frame = av.VideoFrame.from_ndarray(picture, format="gray").reformat(format=layout)
                container.mux(stream.encode(frame))
            container.mux(stream.encode())
    except (av.FFmpegError, ValueError, OSError):
        return b""
    return kept.getvalue()


@cache
def films() -> dict[str, bytes]:
    """Small films by the name of a file."""
    made = {f"{codec}-{layout}.{ending}": film(ending, codec, layout) for ending, codec, layout in CODECS}
    return {name: data for name, data in made.items() if data} | {"fastcam.cine": cine()}


@cache
def cine() -> bytes:
    """A Phantom recording of 8-bit grey pictures."""
    shots = [np.ascontiguousarray(picture[::-1]).tobytes() for picture in pictures()]
    setup = bytearray(0x1700)
    struct.pack_into("<2sH", setup, 0x8C, b"ST", len(setup))
    struct.pack_into("<I", setup, 0x300, RATE)
    struct.pack_into("<I", setup, 0x380, 8)  # bits
    off_bitmap, off_setup = 44, 44 + 40
    off_offsets = off_setup + len(setup)
    head = struct.pack(
        "<2sHHHiIiIIIIII", b"CI", 44, 0, 1, 0, len(shots), 0, len(shots), off_bitmap, off_setup, off_offsets, 0, 0
    )
    bitmap = struct.pack("<IiiHHIIiiII", 40, WIDE, HIGH, 1, 8, 0, WIDE * HIGH, 0, 0, 0, 0)
    first = off_offsets + 8 * len(shots)
    offsets = b"".join(struct.pack("<Q", first + k * (8 + WIDE * HIGH)) for k in range(len(shots)))
    return head + bitmap + bytes(setup) + offsets + b"".join(struct.pack("<II", 8, WIDE * HIGH) + one for one in shots)


@cache
def stacks() -> dict[str, bytes]:
    """TIFF stacks by the name of a file."""
    shots = np.stack(pictures())
    ways: dict[str, Callable[[io.BytesIO], object]] = {
        "plain.tif": partial(tifffile.imwrite, data=shots, photometric="minisblack"),
        "deep.tif": partial(tifffile.imwrite, data=shots.astype(np.uint16) * 16, photometric="minisblack"),
        "big.tif": partial(tifffile.imwrite, data=shots, bigtiff=True, photometric="minisblack"),
        "zlib.tif": partial(tifffile.imwrite, data=shots, compression="zlib", predictor=True, photometric="minisblack"),
        "tiles.tif": partial(tifffile.imwrite, data=shots, tile=(16, 16), photometric="minisblack"),
        "colour.tif": partial(tifffile.imwrite, data=np.stack([shots] * 3, axis=-1), photometric="rgb"),
        "imagej.tif": partial(tifffile.imwrite, data=shots, imagej=True),
        "ome.tif": partial(tifffile.imwrite, data=shots, ome=True, photometric="minisblack"),
    }
    made = {}
    for name, write in ways.items():
        kept = io.BytesIO()
        write(kept)
        made[name] = kept.getvalue()
    return made


def raw_pictures() -> bytes:
    """The pictures as a .mraw file holds them."""
    return b"".join(picture.tobytes() for picture in pictures())


def headers() -> dict[str, str]:
    """Headers of a .mraw file by the name of a file."""
    return {"fast.cih": CIH.format(COUNT) + "Color Bit : 8\n", "fast.cihx": CIHX.format(COUNT)}


@cache
def still(ending: str, number: int = 0) -> bytes:
    """One picture of the film as a file of its own."""
    return bytes(cv2.imencode(ending, pictures()[number])[1].tobytes())


SOUNDS = (
    ("click.wav", "wav", "pcm_s16le"), ("click24.wav", "wav", "pcm_s24le"), ("click.flac", "flac", "flac"),
    ("click.mp3", "mp3", "libmp3lame"), ("click.m4a", "ipod", "aac"), ("click.ogg", "ogg", "libopus"),
    ("click.aac", "adts", "aac"),
)  # fmt: skip


@cache
def sounds() -> dict[str, bytes]:
    """Half a second with four clicks, by the name of a file."""
    return {name: data for name, *how in SOUNDS if (data := _sound(*how))}


def _sound(container: str, codec: str) -> bytes:
    rate = 48000
    time = np.arange(rate // 2) / rate
    wave = np.random.default_rng(2).normal(0, 1e-3, len(time))
    for k, moment in enumerate((0.1, 0.24, 0.33, 0.39)):
        after = np.clip(time - moment, 0, None)
        wave += 0.7**k * np.where(time >= moment, np.exp(-after * 900) * np.sin(2 * np.pi * 4000 * after), 0)
    kept = io.BytesIO()
    try:
        with av.open(kept, "w", format=container) as file:
            stream = file.add_stream(codec, rate=rate)
            stream.layout = "mono"
            whole = av.AudioFrame.from_ndarray((wave * 32767 * 0.5).astype(np.int16)[None], format="s16", layout="mono")
            whole.sample_rate = rate
            fitting = av.AudioResampler(format=stream.format.name, layout="mono", rate=rate)
            for frame in _cut(fitting.resample(whole), stream.frame_size):
                file.mux(stream.encode(frame))
            file.mux(stream.encode())
    except (av.FFmpegError, ValueError, OSError):
        return b""
    return kept.getvalue()


def _cut(frames: Sequence[Any], size: int) -> list[Any]:
    """Frames of the size that a codec asks for."""
    fifo, found = av.AudioFifo(), []
    for frame in frames:
        frame.pts = None
        fifo.write(frame)
    while (part := fifo.read(size or 1024, partial=True)) is not None:
        found.append(part)
    return found
