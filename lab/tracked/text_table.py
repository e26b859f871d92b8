"""Split a text file into a table: separator, decimal sign, comments, titles, names and a row of units."""

from __future__ import annotations

import csv
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from rigtwin.lab.errors import BadInput
from rigtwin.lab.input_files import LARGEST_TABLE, must_have_few_rows, read_bytes
from rigtwin.lab.media_files import ending_of, kind_of
from rigtwin.lab.tracked.columns import body_and_axis, is_unit, role_of
from rigtwin.lab.tracked.table import Table

SEPARATORS = ("\t", ";", ",", " ")  # " " is any white space; the first of equally good ones is taken

COMMENT = re.compile(r"\s*(?:#|%|//)+\s?")

_NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?|[+-]?(?:nan|inf|infinity)", re.IGNORECASE)

_CLOCK = re.compile(r"(?:(\d+):)?(\d{1,2}):(\d{2})[:.,](\d{1,6})")  # h:mm:ss and decimals of a second

# names of columns that only one program writes, and the unit of lengths where its file states none
PROGRAMS: tuple[tuple[str, frozenset[str], str], ...] = (
    ("TrackMate spots", frozenset({"TRACK_ID", "POSITION_X", "POSITION_Y"}), "px"),
    ("MTrack2 table", frozenset({"Frame", "X1", "Y1", "Flag1"}), "px"),
    ("ImageJ Manual Tracking table", frozenset({"X", "Y", "Distance", "Velocity"}), "px"),
    ("trackpy table", frozenset({"x", "y", "mass", "size", "ecc", "frame"}), "px"),
    ("ImageJ results", frozenset({"Area", "X", "Y"}), "px"),
    ("ImageJ results", frozenset({"Area", "XM", "YM"}), "px"),
)


@dataclass(frozen=True)
class _Line:
    number: int
    text: str
    comment: bool
    block: int


def read_text_table(path: Path) -> Table:
    """Read a text file as a table.

    Parameters
    ----------
    path : Path
        The file; its text is in UTF-8, UTF-16 (with its mark) or Windows' Latin 1.

    Returns
    -------
    Table
        Cells as text with decimal points.

    Raises
    ------
    BadInput
        If the file cannot be read, holds no rows of numbers, or a row has another number of cells.
    """
    lines = _lines(path)
    separator, width = _separator(path, [line for line in lines if not line.comment])
    split = [(line, _cells(line.text, separator)) for line in lines]
    first = next(k for k, (line, cells) in enumerate(split) if not line.comment and _is_data(cells, width, separator))
    heads = [(line, cells) for line, cells in split[:first] if any(cells)]
    body = [(line, cells) for line, cells in split[first:] if not line.comment]
    end = next((k for k in range(1, len(body)) if _begins_another(body[k - 1][0], *body[k], separator)), None)
    left_out = () if end is None else (f"rows from line {body[end][0].number} on are another table and were not read",)
    body = body[:end]
    at = _names_at(heads, width)
    for line, cells in heads[0 if at is None else at + 1 :]:
        # a damaged row, no header: below the names no line of a header holds a number
        if not line.comment and sum(_is_number(cell, separator) for cell in cells) >= (2 if at is None else 1):
            raise _uneven(path, line, len(cells), width, separator)
    names, units, titles = _header(heads, width, at)
    if nameless := not any(names):
        names = tuple(str(k + 1) for k in range(width))
    for line, cells in body:
        if len(cells) != width:
            raise _uneven(path, line, len(cells), width, separator)
    kind, default, up = _kind([line.text for line, _ in heads], names, titles)
    if titles == () and kind == "Tracker table" and heads:
        titles = tuple(heads[0][1][0] for _ in names)
    rows = tuple(tuple(_plain_number(cell, separator) for cell in cells) for _, cells in body)
    kept = [k for k in range(width) if (names[k] and not nameless) or any(row[k] for row in rows)]
    return Table(
        path,
        kind,
        tuple(names[k] for k in kept),
        tuple(units[k] if units else "" for k in kept),
        tuple(titles[k] if titles else "" for k in kept),
        tuple(tuple(row[k] for k in kept) for row in rows),
        tuple(line.block for line, _ in body),
        default,
        up,
        left_out,
    )


def _uneven(path: Path, line: _Line, cells: int, width: int, separator: str) -> BadInput:
    commas = separator == "," and cells > width
    advice = "; numbers with decimal commas need semicolons or tabs between them" if commas else ""
    return BadInput(f"{path}, line {line.number}: {cells} cells where the table has {width}{advice}.")


def _begins_another(before: _Line, line: _Line, cells: Sequence[str], separator: str) -> bool:
    """Whether a line begins another table: after a blank line, it holds no number, as names of columns."""
    return before.block != line.block and not any(_is_number(cell, separator) for cell in cells)


def _lines(path: Path) -> list[_Line]:
    raw = read_bytes(path, advice="give a table of tracked data", largest=LARGEST_TABLE)
    must_have_few_rows(path, raw.count(b"\n"))
    text = _decoded(raw)
    if text is None:
        raise BadInput(f"{path}: {_what_else(path, raw)}.")
    lines: list[_Line] = []
    block, blank = 0, False
    for number, line in enumerate(text.splitlines(), start=1):
        if not line.strip():
            blank = bool(lines)
            continue
        block, blank = block + blank, False
        comment = COMMENT.match(line)
        lines.append(_Line(number, line[comment.end() :] if comment else line, comment is not None, block))
    return lines


def _what_else(path: Path, raw: bytes) -> str:
    """What a file that should be a table is by its first bytes, and what to do."""
    kind = kind_of(raw)
    what = f"{kind} by its first bytes" if kind else "not a text file"
    what = f"is taken for a table by its ending {path.suffix}, and is {what}"
    if ending := ending_of(kind):
        return f"{what}; rename it to {path.stem.removesuffix(ending)}{ending}"
    return f"{what}; give a table of tracked data as CSV or text, or a clip with the usual ending of its format"


def _decoded(raw: bytes) -> str | None:
    codings = ("utf-16",) if raw[:2] in (b"\xff\xfe", b"\xfe\xff") else ("utf-8-sig", "cp1252")
    for coding in codings:
        try:
            text = raw.decode(coding)
        except UnicodeDecodeError:
            continue
        return None if any(ord(sign) < 32 and sign not in "\t\r\n\f" for sign in text) else text
    return None


def _separator(path: Path, lines: Sequence[_Line]) -> tuple[str, int]:
    """Separator and number of cells for which most lines are rows of numbers."""
    best, found = 0, ("", 0)
    for separator in SEPARATORS:
        rows = [_cells(line.text, separator) for line in lines]
        widths = Counter(len(cells) for cells in rows if _is_data(cells, len(cells), separator))
        if widths and widths.most_common(1)[0][1] > best:
            width, best = widths.most_common(1)[0]
            found = separator, width
    if not best:
        raise BadInput(f"{path}: holds no rows of at least two numbers; give a table of tracked data.")
    return found


def _cells(text: str, separator: str) -> list[str]:
    if separator == " ":
        return text.split()
    return [cell.strip() for cell in next(csv.reader([text], delimiter=separator))]


def _is_data(cells: Sequence[str], width: int, separator: str) -> bool:
    """Whether a line is a row of the table: a number in at least two cells, or a number and gaps."""
    numbers = sum(_is_number(cell, separator) for cell in cells)
    return len(cells) == width >= 2 and (numbers >= 2 or (numbers == 1 and cells.count("") == width - 1))


def _is_number(cell: str, separator: str) -> bool:
    return _NUMBER.fullmatch(_plain_number(cell, separator)) is not None


def _plain_number(cell: str, separator: str) -> str:
    """The cell with a decimal point, a time of day in seconds."""
    if clock := _CLOCK.fullmatch(cell):
        hours, minutes, seconds, decimals = clock.groups()
        return f"{int(hours or 0) * 3600 + int(minutes) * 60 + int(seconds)}.{decimals}"
    quoted = cell.replace(",", ".") if cell.count(",") == 1 and "." not in cell else cell
    return quoted if _NUMBER.fullmatch(quoted) else cell


def _names_at(heads: Sequence[tuple[_Line, list[str]]], width: int) -> int | None:
    """The number of the line with the names of the columns; None where there is none."""
    full = [_padded(cells, width) for _, cells in heads]
    known = [k for k, cells in enumerate(full) if cells and _known(cells)]
    return known[0] if known else next((k for k in reversed(range(len(full))) if full[k]), None)


def _header(heads: Sequence[tuple[_Line, list[str]]], width: int, at: int | None) -> tuple[tuple[str, ...], ...]:
    """Names (in line `at`), units and titles of the columns; empty tuples where there are none."""
    if at is None:
        return ("",) * width, (), ()
    full = [_padded(cells, width) for _, cells in heads]
    names = full[at]
    assert names is not None
    units: tuple[str, ...] = next((cells for cells in full[at + 1 :] if cells and _all_units(cells)), ())
    above = next((cells for cells in reversed(full[:at]) if cells and any(cells)), None)
    return names, tuple(unit.strip("()[] ") for unit in units), () if above is None else _spread(above)


def _padded(cells: Sequence[str], width: int) -> tuple[str, ...] | None:
    """A row of the header in the table's width, None if it has another; a separator at its end is no cell."""
    trimmed = [*cells]
    while len(trimmed) > width and not trimmed[-1]:
        trimmed.pop()
    return tuple([*trimmed, ""][:width]) if width - 1 <= len(trimmed) <= width else None


def _known(cells: Sequence[str]) -> bool:
    return sum(role_of(cell)[0] != "" or body_and_axis(cell) is not None for cell in cells) >= min(2, len(cells))


def _all_units(cells: Sequence[str]) -> bool:
    stated = [cell.strip("()[] ") for cell in cells if cell]
    return bool(stated) and all(is_unit(cell) or cell == "quality" for cell in stated)


def _spread(titles: Sequence[str]) -> tuple[str, ...]:
    """Titles, each over its own column and the empty ones to its right."""
    spread, last = [], ""
    for title in titles:
        last = title or last
        spread.append(last)
    return tuple(spread)


def _kind(heads: Sequence[str], names: Sequence[str], titles: Sequence[str]) -> tuple[str, str, bool | None]:
    """What wrote the table, the unit of lengths where none is stated, and whether y counts upwards."""
    above = " ".join(heads)
    if "Kinovea" in above:
        return "Kinovea text", "px", None
    if "Vernier Format" in above:
        return "Logger Pro text", "m", None
    if any(re.match(r"(Latest|Data Set[^:]*|Run[^:]*|Video Analysis[^:]*):", name) for name in names):
        return "Logger Pro table", "m", None
    if any(re.search(r"/\d+/[XY]\b", name) for name in names):
        return "Kinovea table", "px", None
    for kind, marks, default in PROGRAMS:
        if marks <= set(names):
            return kind, default, None
    bare = [name.strip() for name in names]
    if (
        bare
        and bare[0] == "t"
        and {"x", "y"} <= set(bare)
        and (titles or (len(heads) == 2 and len(heads[0].split()) < 3))
    ):
        return "Tracker table", "m", None
    return "table", "", None
