"""Change single keys of a lab.toml, with everything else in it left as it is: comments, order, blank lines.

A change is checked twice before it is written: nothing else in the file has another value, and the file is still a
valid lab.toml.
"""

from __future__ import annotations

import shutil
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from difflib import SequenceMatcher
from pathlib import Path
from typing import Any

import tomlkit
from tomlkit.exceptions import TOMLKitError
from tomlkit.items import Array

from rigtwin.lab.errors import BadInput
from rigtwin.lab.file.lab_file import lab_of
from rigtwin.lab.file.schema import parsed
from rigtwin.lab.output_files import replacing

BOM = "\ufeff"

Value = str | float | bool | Sequence[str] | None
"""What a key shall hold; None takes it out."""


@dataclass
class LabEdit:
    """Changes to one lab.toml, the last of which can be undone.

    Attributes
    ----------
    path : Path
        The lab.toml.
    allow_outside : bool
        Whether the lab may name files outside its folder.
    """

    path: Path
    allow_outside: bool = False
    _done: list[tuple[bytes, bytes]] = field(default_factory=list)  # content before and after each change

    @property
    def can_undo(self) -> bool:
        """Whether the last change made here is the last one of the file."""
        return bool(self._done) and self.path.read_bytes() == self._done[-1][1]

    def set(self, experiment: int, key: str, value: Value, *, file: str | None = None) -> None:
        """Write one key of ``[experiments.camera]``, or of ``[experiments.files.FILE]``; None takes it out.

        Parameters
        ----------
        experiment : int
            Number of the experiment, from 0.
        key : str
            Name of the key.
        value : str, float, bool, sequence of str or None
            What it shall hold.
        file : str, optional
            The file that the key is for, by its name in `repetitions`; by default all of the experiment.

        Raises
        ------
        BadLabFile
            If lab.toml would not be valid then; nothing is written.
        BadInput
            If it cannot be changed without changing something else.
        """
        before = self.path.read_bytes()
        table = ("camera",) if file is None else ("files", file)
        after = with_key(before, self.path, experiment, (*table, key), value)
        lab_of(parsed(self.path, after), allow_outside=self.allow_outside)
        if after != before:
            self._write(after)
            self._done.append((before, after))

    def undo(self) -> None:
        """Take the last change back.  Raises `BadInput` if there is none, or the file was changed since."""
        if not self._done:
            raise BadInput(f"{self.path}: nothing was changed here that could be undone.")
        if not self.can_undo:
            raise BadInput(f"{self.path}: was changed elsewhere since; take that back first, or edit the file itself.")
        before, _ = self._done.pop()
        self._write(before)

    def _write(self, content: bytes) -> None:
        file = self.path.resolve()  # a link stays one
        with replacing(file) as part:
            part.write_bytes(content)
            shutil.copymode(file, part)


def with_key(content: bytes, path: Path, experiment: int, key: Sequence[str], value: Value) -> bytes:
    """Return the content of lab.toml with one key of an experiment set, or taken out if `value` is None.

    Parameters
    ----------
    content : bytes
        What lab.toml holds.
    path : Path
        Its name, for messages.
    experiment : int
        Number of the experiment, from 0.
    key : sequence of str
        Tables and key within the experiment, like ``("camera", "base")``.
    value : str, float, bool, sequence of str or None
        What it shall hold.

    Returns
    -------
    bytes
        Content of lab.toml after the change.

    Raises
    ------
    BadInput
        If the experiment is not there, or the text cannot be changed without changing something else.

    Examples
    --------
    >>> lab = b'[[experiments]]\\nid = "a" # first\\n\\n[[experiments]]\\nid = "b"\\n'
    >>> print(with_key(lab, Path("lab.toml"), 0, ("camera", "base"), "1,2,30,4").decode())
    [[experiments]]
    id = "a" # first
    <BLANKLINE>
    [experiments.camera]
    base = "1,2,30,4"
    <BLANKLINE>
    [[experiments]]
    id = "b"
    <BLANKLINE>
    """
    data = parsed(path, content).data
    experiments = data.get("experiments")
    if not isinstance(experiments, list) or not 0 <= experiment < len(experiments):
        raise BadInput(f"{path}: has no experiment {experiment + 1} any more; load the page again.")
    text = content.decode("utf-8").removeprefix(BOM)
    wanted = _changed(data, experiment, key, value)
    if wanted == data:
        return content
    try:
        document = tomlkit.parse(text.replace("\r\n", "\n"))
        _put(document["experiments"][experiment], key, value)
        changed = tomlkit.dumps(document)
        if value is None or not _holds(data["experiments"][experiment], key):  # whole lines come or go
            changed = _laid_out(text.replace("\r\n", "\n"), changed)
        right = tomllib.loads(changed) == wanted
    except (TOMLKitError, ValueError, TypeError, KeyError, AttributeError):  # a layout that tomlkit cannot change
        right = False
    if not right:
        line = "take it out" if value is None else f"write {key[-1]} = {tomlkit.item(value).as_string()}"
        raise BadInput(
            f"{path}: its layout cannot be changed here without changing more; {line} under "
            f"[experiments.{'.'.join(map(_quoted, key[:-1]))}] by hand."
        )
    mark = BOM if content.startswith(BOM.encode()) else ""
    ends = "\r\n" if "\r\n" in text else "\n"
    return (mark + changed.replace("\n", ends)).encode()


def _quoted(name: str) -> str:
    return tomlkit.key(name).as_string()


def _changed(data: Mapping[str, Any], experiment: int, key: Sequence[str], value: Value) -> dict[str, Any]:
    """What the file shall hold."""
    experiments = list(data["experiments"])
    experiments[experiment] = _nested(experiments[experiment], key, value)
    return {**data, "experiments": experiments}


def _nested(table: Mapping[str, Any], key: Sequence[str], value: Value) -> dict[str, Any]:
    first, *others = key
    if others:
        held = table.get(first, {})
        inner: Any = _nested(held if isinstance(held, Mapping) else {}, others, value)
    else:
        inner = list(value) if isinstance(value, list | tuple) else value
    kept = {name: each for name, each in table.items() if name != first}
    return kept if inner in (None, {}) else {**table, first: inner}


def _holds(table: Mapping[str, Any], key: Sequence[str]) -> bool:
    first, *others = key
    return first in table and (not others or _holds(table[first], others))


def _put(table: Any, key: Sequence[str], value: Value) -> None:
    first, *others = key
    if not others:
        if value is None:
            table.remove(first)
        elif not isinstance(value, list | tuple):
            table[first] = value
        elif not (isinstance(table.get(first), Array) and _edited(table[first], value)):
            table[first] = list(value)
        return
    if first not in table:
        # [experiments.files] itself needs no header, as only tables stand in it
        table[first] = tomlkit.table(is_super_table=len(others) > 1)
    _put(table[first], others, value)
    if not table[first]:
        table.remove(first)


def _edited(array: Array, wanted: Sequence[str]) -> bool:
    """Whether only the entries that differ could be changed, so that the lines and comments of the array stay."""
    steps = SequenceMatcher(None, array.unwrap(), list(wanted), autojunk=False).get_opcodes()
    for _, begin, end, first, last in reversed(steps):  # from the end, so that the earlier places stay
        new = wanted[first:last]
        for place, entry in zip(range(begin, end), new, strict=False):
            if array[place] != entry:
                array[place] = entry
        for place in reversed(range(begin + len(new), end)):
            del array[place]
        for place, entry in enumerate(new[end - begin :], start=end):
            array.insert(place, entry)
    return bool(tomllib.loads(f"it = {array.as_string()}") == {"it": list(wanted)})


def _laid_out(before: str, after: str) -> str:
    """The changed text with its new lines behind the keys that they belong to, and one blank line before a header.

    A comment behind a blank line is about what follows, so new lines stand before both.
    """
    old, new = before.split("\n"), after.split("\n")
    same = _common(old, new)
    same_end = _common(old[same:][::-1], new[same:][::-1])
    gone, added = old[same : len(old) - same_end], new[same : len(new) - same_end]
    head, tail = old[:same], old[len(old) - same_end :]
    if not any(gone):
        lines = [line for line in added if line]
        keys = max((k for k, line in enumerate(head) if line and not line.startswith("#")), default=-1) + 1
        place = next((k for k in range(keys, same) if not head[k].strip()), same)
        head, tail = head[:place], [*head[place:], *gone, *tail]
        added = ["", *lines] if lines[:1] and lines[0].startswith("[") else lines
        tail = tail if tail and not tail[0].strip() else ["", *tail]
    elif not any(added):
        # a blank line stood on either side of what is gone
        added = []
        if head and tail and not head[-1].strip() and not tail[0].strip():
            head = head[:-1]
    return "\n".join([*head, *added, *tail])


def _common(one: Sequence[str], other: Sequence[str]) -> int:
    """How many lines are the same from the beginning."""
    return next((k for k, (a, b) in enumerate(zip(one, other, strict=False)) if a != b), min(len(one), len(other)))
