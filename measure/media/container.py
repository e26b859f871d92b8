"""Open films and sound with FFmpeg (PyAV): local files only, in formats that hold their pictures themselves."""

from __future__ import annotations

import errno
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Literal

import av
import numpy as np

from rigtwin.lab.errors import UnreadableMedia
from rigtwin.lab.input_files import opened
from rigtwin.lab.media_files import kind_of
from rigtwin.measure.media.picture_size import must_have_room

FORMATS = (
    "mov", "mp4", "m4a", "3gp", "3g2", "mj2", "matroska", "webm", "avi", "asf", "mpegts", "mpeg", "mpegvideo", "m4v",
    "h264", "hevc", "ivf", "mjpeg", "flv", "ogg", "cine", "mxf", "nut", "dv", "gif", "apng", "yuv4mpegpipe", "av1",
    "wav", "w64", "aiff", "flac", "mp3", "aac", "caf", "au",
)  # fmt: skip
"""FFmpeg's names of the formats that are read; those of play lists, which open other files, are not among them."""

LISTS = (b"ffconcat version", b"#EXTM3U", b"<MPD", b"[playlist]", b"CWSF")
"""How play lists begin, or what stands near their beginning."""

SHORT_OF_MEMORY = (errno.ENOMEM, errno.EAGAIN)  # the second one where a decoder's thread cannot begin

METADATA: dict[str, Any] = {"metadata_errors": "replace"} if int(av.__version__.partition(".")[0]) < 19 else {}
"""Metadata that are no text do not matter; from version 19 on PyAV takes it that way itself."""

REFUSALS = {
    "video": (
        "holds no video; give a clip that a video player shows.",
        "FFmpeg has no decoder for its pictures; save the clip as H.264.",
    ),
    "audio": (
        "the file has no sound track.",
        "FFmpeg has no decoder for its sound; save it as WAV.",
    ),
}
"""By kind of stream: the refusal of a file without one, and of a file whose stream FFmpeg cannot decode."""

HEAD = 512  # [bytes], in which a play list shows itself


@contextmanager
def open_container(path: Path) -> Iterator[Any]:
    """Open a film or sound recording, and nothing else that its name or its content may ask for.

    Parameters
    ----------
    path : Path
        The file. It is opened as a file even if its name looks like that of a protocol (``tcp:...``, ``10:30.mp4``).

    Yields
    ------
    av.container.InputContainer
        The open container.

    Raises
    ------
    UnreadableMedia
        The file is missing, no ordinary file, a play list, or its pictures are too large.
    av.FFmpegError
        FFmpeg cannot read it.
    MemoryError
        Memory is short: no fault of the file.
    """
    with opened(path, advice="give a clip that a video player shows", refuse=UnreadableMedia) as file:
        head = file.read(HEAD)
    if any(mark in head for mark in LISTS):
        raise UnreadableMedia(f"{path}: is a list that names other files, not a clip; give the clips themselves.")
    allowed = {"protocol_whitelist": "file", "format_whitelist": ",".join(FORMATS)}
    try:
        with av.open(f"file:{path.absolute()}", options=allowed, **METADATA) as container:
            for stream in container.streams.video:
                if stream.codec_context is not None:
                    must_have_room(path, stream.width, stream.height)
            yield container
    except av.FFmpegError as error:
        if error.errno == errno.ENOMEM and memory_is_there():
            raise UnreadableMedia(
                f"{path}: FFmpeg is refused memory, as for damaged files that ask for more than 2 GB at once; copy it "
                "again."
            ) from None
        if error.errno in SHORT_OF_MEMORY:
            raise MemoryError from error
        if (kind := kind_of(head)) and not kind.startswith(("a film", "a sound")):
            raise UnreadableMedia(f"{path}: is {kind} and no film; give a clip that a video player shows.") from None
        raise


DECODER = 2**28  # [bytes], more than a decoder needs for its pictures


def memory_is_there(size: int = 2**31) -> bool:
    """Whether there is so much memory [bytes]; by default as much as FFmpeg gives at most at once."""
    try:
        np.empty(size, dtype=np.uint8)
    except MemoryError:
        return False
    return True


def first_stream(container: Any, path: Path, kind: Literal["video", "audio"]) -> Any:
    """Return the pictures or the sound of an open container.

    Parameters
    ----------
    container : av.container.InputContainer
        The container.
    path : Path
        Its file, for messages.
    kind : str
        ``"video"`` or ``"audio"``.

    Returns
    -------
    av.stream.Stream
        The first of them.

    Raises
    ------
    UnreadableMedia
        There is none, or FFmpeg has no decoder for it.
    """
    streams = getattr(container.streams, kind)
    absent, undecoded = REFUSALS[kind]
    if not streams:
        raise UnreadableMedia(f"{path}: {absent}")
    if streams[0].codec_context is None:
        raise UnreadableMedia(f"{path}: {undecoded}")
    return streams[0]
