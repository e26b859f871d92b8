"""Photron high-speed recordings: header (.cihx or .cih) and raw pictures (.mraw)."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element, ParseError

import numpy as np
import numpy.typing as npt
from defusedxml import DefusedXmlException
from defusedxml.ElementTree import fromstring

from rigtwin.lab.errors import UnreadableMedia
from rigtwin.lab.input_files import LARGEST_NOTES, read_bytes
from rigtwin.measure.media.picture_size import must_have_room
from rigtwin.measure.media.pictures import Picture, counted_pictures, eight_bit
from rigtwin.measure.media.video_file import Apart


@dataclass(frozen=True)
class _PhotronHeader:
    rate: float
    width: int
    height: int
    count: int
    bits: int  # per stored pixel
    used: int  # bits per pixel that the sensor fills


class Photron(Apart):
    """A Photron recording: header (.cihx or .cih) and raw pictures (.mraw) with 8, 12 (packed) or 16 bits per pixel."""

    tick = 0.0

    def __init__(self, path: Path) -> None:
        found = [file for end in (".cihx", ".cih") if (file := path.with_suffix(end)).is_file()]
        if not found:
            raise UnreadableMedia(f"{path}: its header is missing; put the .cihx or .cih file beside it.")
        self.raw = path.with_suffix(".mraw")
        if not self.raw.is_file():
            raise UnreadableMedia(f"{path}: its pictures are missing; put {self.raw.name} beside it.")
        self.header = header = _photron_header(found[0])
        must_have_room(path, header.width, header.height)
        size = header.width * header.height * header.bits // 8
        whole = self.raw.stat().st_size // size
        self.notes: tuple[str, ...] = ()
        if whole < header.count:
            self.notes = (f"{self.raw.name} holds {whole} of {counted_pictures(header.count)}; only those were used.",)
        self.shape = (header.height, header.width)
        self.rate = header.rate
        self.stamps: list[float | None] = [k / header.rate for k in range(min(whole, header.count))]

    def pictures(self, start: int = 0) -> Iterator[Picture]:
        header = self.header
        pixels = header.width * header.height
        size = pixels * header.bits // 8
        with self.raw.open("rb") as file:
            file.seek(start * size)
            for _ in self.stamps[start:]:
                data = np.frombuffer(file.read(size), dtype=np.uint8)
                yield eight_bit(_unpacked(data, header.bits).reshape(self.shape), header.used - 8)


def _photron_header(path: Path) -> _PhotronHeader:
    advice = "save the recording as TIFF or AVI"
    text = read_bytes(path, advice=advice, largest=LARGEST_NOTES, refuse=UnreadableMedia).decode(errors="replace")
    try:
        if path.suffix.lower() == ".cihx":
            # the XML part is embedded between binary blocks
            root: Element = fromstring(text[text.index("<cih>") : text.index("</cih>") + len("</cih>")])
            found = {
                "Record Rate(fps)": root.findtext("recordInfo/recordRate"),
                "Image Width": root.findtext("imageDataInfo/resolution/width"),
                "Image Height": root.findtext("imageDataInfo/resolution/height"),
                "Total Frame": root.findtext("frameInfo/totalFrame"),
                "Color Bit": root.findtext("imageDataInfo/colorInfo/bit"),
                "EffectiveBit Depth": root.findtext("imageDataInfo/effectiveBit/depth"),
            }
            words: dict[str, str] = {key: value for key, value in found.items() if value is not None}
        else:
            words = dict(re.findall(r"^([^:#\n]+?)\s*:\s*(.+?)\s*$", text, re.MULTILINE))
        bits = int(words["Color Bit"])
        header = _PhotronHeader(
            rate=float(words["Record Rate(fps)"].split("/")[0]),
            width=int(words["Image Width"]),
            height=int(words["Image Height"]),
            count=int(words["Total Frame"]),
            bits=bits,
            used=int(words.get("EffectiveBit Depth", bits)),
        )
    except (KeyError, ValueError, ParseError, DefusedXmlException):
        raise UnreadableMedia(
            f"{path}: rate, size or bit depth cannot be read from it; save the recording as TIFF or AVI."
        ) from None
    if not (math.isfinite(header.rate) and header.rate > 0 and min(header.width, header.height, header.count) > 0):
        raise UnreadableMedia(
            f"{path}: states {header.rate:g} pictures per second, {header.count} pictures and "
            f"{header.width} x {header.height} px, which must be above zero; save the recording as TIFF or AVI."
        )
    if header.bits not in (8, 12, 16) or not 8 <= header.used <= 16:
        raise UnreadableMedia(
            f"{path}: {header.bits} bits per pixel cannot be read; save the recording as TIFF or AVI."
        )
    return header


def _unpacked(data: npt.NDArray[np.uint8], bits: int) -> npt.NDArray[Any]:
    if bits == 8:
        return data
    if bits == 16:
        return data.view("<u2")
    three = data.reshape(-1, 3).astype(np.uint16)  # two pixels in three bytes
    pair = np.stack([(three[:, 0] << 4) | (three[:, 1] >> 4), ((three[:, 1] & 15) << 8) | three[:, 2]], axis=1)
    return pair.reshape(-1)
