"""Read the sound of a recording or a film."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import av
import numpy as np

from rigtwin.lab.arrays import Array
from rigtwin.lab.errors import UnreadableMedia
from rigtwin.lab.media_files import SOUNDS
from rigtwin.measure.media.container import first_stream, open_container
from rigtwin.measure.media.pictures import reason

LONGEST_SOUND = 3600.0  # [s], which at 48 kHz takes two gigabytes while it is evaluated

LOSSLESS = ("pcm", "flac", "alac", "wavpack")


@dataclass(frozen=True)
class Sound:
    """Sound pressure over time, in arbitrary units; the mean of all channels."""

    samples: Array  # shape (n,)
    rate: float  # [1/s]
    start: float  # [s], time of the first sample
    lossy: bool = False  # whether the codec spreads clicks in time, as AAC and MP3 do


def is_sound(path: Path) -> bool:
    """Whether the suffix of a file is that of a sound recording."""
    return path.suffix.lower() in SOUNDS


def has_sound(path: Path) -> bool:
    """Whether a file holds a sound track that can be opened."""
    try:
        with open_container(path) as container:
            return any(stream.codec_context is not None for stream in container.streams.audio)
    except MemoryError:
        raise
    except (av.FFmpegError, OSError, UnreadableMedia):
        return False


def read_sound(path: Path) -> Sound:
    """Read the first sound track of a file.

    Raises `UnreadableMedia` if there is none or it cannot be decoded.
    """
    if not path.exists():
        raise UnreadableMedia(f"{path}: no such file; give a sound recording or a film with sound.")
    try:
        with open_container(path) as container:
            stream = first_stream(container, path, "audio")
            resampler = av.AudioResampler(format="flt", layout="mono")
            lossy = not stream.codec_context.name.startswith(LOSSLESS)
            parts, start, rate, kept = [], None, float(stream.rate or 0), 0
            for frame in container.decode(stream):
                start = frame.time if start is None else start
                parts += [each.to_ndarray().ravel() for each in resampler.resample(frame)]
                if (kept := kept + frame.samples) > LONGEST_SOUND * rate:
                    raise UnreadableMedia(
                        f"{path}: has more than {LONGEST_SOUND / 60:.0f} minutes of sound; cut the impacts out of it."
                    )
            parts += [each.to_ndarray().ravel() for each in resampler.resample(None)]
    except (UnreadableMedia, MemoryError):
        raise
    except Exception as error:  # FFmpeg's, and PyAV's own at streams that it does not expect
        raise UnreadableMedia(f"{path}: the sound cannot be decoded ({reason(error)}).") from None
    if not parts or not rate > 0:
        raise UnreadableMedia(f"{path}: the sound track is empty.")
    return Sound(np.concatenate(parts).astype(np.float64), rate, float(start or 0.0), lossy)
