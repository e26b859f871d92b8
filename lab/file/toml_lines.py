"""On which line of a TOML text each key stands, so that an error can point at it.

`tomllib` forgets the lines; this small scanner finds them in a text that `tomllib` has already accepted.
"""

from __future__ import annotations

import re
import tomllib
from bisect import bisect_left

Key = tuple[str | int, ...]
"""Path to a value: table names and list indices, ``("experiments", 0, "camera", "frame_rate")``."""


_BLANK = re.compile(r"[ \t\n]+|#[^\n]*")
_STRING = re.compile(  # a multi-line text may end in one or two quotes of its own
    r'''"""(?:[^\\]|\\.)*?"{3,5}|\'{3}.*?\'{3,5}|"(?:[^"\\]|\\.)*"|\'[^\']*\'''', re.DOTALL
)


def key_lines(text: str) -> dict[Key, int]:
    """Find the line of every key, table and list item.

    Parameters
    ----------
    text : str
        A valid TOML text.

    Returns
    -------
    dict of Key to int
        Lines, 1 for the first.

    Examples
    --------
    >>> lines = key_lines('[lab]\\ntitle = "ash"\\n[[experiments]]\\nrepetitions = ["a.mp4",\\n"b.mp4"]')
    >>> lines["lab", "title"], lines["experiments", 0], lines["experiments", 0, "repetitions", 1]
    (2, 3, 5)
    """
    scanner = _Scanner(text.replace("\r\n", "\n"))
    scanner.document()
    return scanner.lines


def dotted(key: Key) -> str:
    """Return a path as a person says it, who counts from one.

    Parameters
    ----------
    key : Key
        Path of a key: names, and indices from 0.

    Returns
    -------
    str
        The words.

    Examples
    --------
    >>> dotted(("experiments", 2, "camera", "frame_rate")), dotted(("experiments", 0, "repetitions", 1, 0))
    ('experiment 3, camera.frame_rate', 'experiment 1, repetition 2, item 1')
    """
    words: list[str] = []
    for before, part in zip((None, *key), key, strict=False):
        if isinstance(part, str):
            words.append(f"{'.' if isinstance(before, str) else ', '}{_quoted(part)}")
        elif isinstance(before, str) and before.endswith("s"):
            words[-1] = f"{words[-1].removesuffix('s')} {part + 1}"
        elif isinstance(before, str):
            words.append(f", number {part + 1}")
        else:
            words.append(f", item {part + 1}")
    return "".join(words).removeprefix(", ")


def _quoted(name: str) -> str:
    return name if re.fullmatch(r"[A-Za-z0-9_-]+", name) else f'"{name}"'


class _Scanner:
    def __init__(self, text: str) -> None:
        self.text = text
        self.at = 0
        self.ends = [end.start() for end in re.finditer("\n", text)]
        self.lines: dict[Key, int] = {(): 1}
        self.tables_in: dict[Key, int] = {}  # array of tables -> how many so far

    def document(self) -> None:
        table: Key = ()
        while self._next():
            if self.text.startswith("[", self.at):
                table = self._header()
            else:
                self._pair(table)

    def _header(self) -> Key:
        array = self.text.startswith("[[", self.at)
        self.at += 2 if array else 1
        line, names = self._line(), self._key()
        self.at += 2 if array else 1
        path = self._mark((), names[:-1] if array else names, line)
        if array:
            path += (names[-1],)
            self.lines.setdefault(path, line)
            self.tables_in[path] = self.tables_in.get(path, 0) + 1
            path += (self.tables_in[path] - 1,)
        self.lines[path] = line
        return path

    def _mark(self, path: Key, names: list[str], line: int) -> Key:
        for name in names:
            path += (name,)
            self.lines.setdefault(path, line)
            if path in self.tables_in:  # [experiments.camera] belongs to the latest [[experiments]]
                path += (self.tables_in[path] - 1,)
        return path

    def _pair(self, table: Key) -> None:
        line, names = self._line(), self._key()
        path = self._mark(table, names, line)
        self.at += 1  # the equals sign
        self._value(path)

    def _key(self) -> list[str]:
        names = []
        while True:
            self._next()
            start = self.at
            if self.text[self.at] in "\"'":
                self._string()
                names.append(str(tomllib.loads(f"name = {self.text[start : self.at]}")["name"]))
            else:
                while self.at < len(self.text) and (self.text[self.at].isalnum() or self.text[self.at] in "_-"):
                    self.at += 1
                names.append(self.text[start : self.at])
            self._next()
            if not self.text.startswith(".", self.at):
                return names
            self.at += 1

    def _value(self, path: Key) -> None:
        self._next()
        character = self.text[self.at]
        if character in "\"'":
            self._string()
        elif character == "[":
            self._array(path)
        elif character == "{":
            self._inline_table(path)
        else:  # a number, a truth value or a date, which may hold a space
            while self.at < len(self.text) and self.text[self.at] not in ",]}\n#":
                self.at += 1

    def _array(self, path: Key) -> None:
        self.at += 1
        index = 0
        while self._next() and self.text[self.at] != "]":
            self.lines[(*path, index)] = self._line()
            self._value((*path, index))
            index += 1
            self._next()
            if self.text[self.at] == ",":
                self.at += 1
        self.at += 1

    def _inline_table(self, path: Key) -> None:
        self.at += 1
        while self._next() and self.text[self.at] != "}":
            self._pair(path)
            self._next()
            if self.text[self.at] == ",":
                self.at += 1
        self.at += 1

    def _string(self) -> None:
        match = _STRING.match(self.text, self.at)
        assert match is not None  # tomllib has accepted the text
        self.at = match.end()

    def _next(self) -> bool:
        """Move past blanks, line ends and comments; False at the end of the text."""
        while match := _BLANK.match(self.text, self.at):
            self.at = match.end()
        return self.at < len(self.text)

    def _line(self) -> int:
        return bisect_left(self.ends, self.at) + 1
