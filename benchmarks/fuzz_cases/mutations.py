"""Random changes of bytes and of text.

Some changes begin at an earlier result in place of the right input: one that led to an end of its own (`keep_made`), as
a refusal that was not seen before, so that several changes add up.
"""

from __future__ import annotations

import re
from random import Random

EXTREMES = (
    "0", "-1", "1e-300", "1e300", "1e999", "nan", "inf", "-inf", "1e15", "999999999999", "", "'", "%s", "../..", "\0",
    "\x1b[31m", "é", "½", "١", "1_0", "0x10", "true", "[]", "{}", "+5", ".5", "5.", "1,5",
)  # fmt: skip
NUMBERS = (0, 1, 2**7, 2**8 - 1, 2**15, 2**16 - 1, 2**31 - 1, 2**31, 2**32 - 1, 2**63 - 1, 2**64 - 1)
FROM_EARLIER = 0.3  # share of changes that begin at an earlier result
MOST_KEPT = 40  # results kept of an input
HEAD = 512  # [bytes] of a binary file, [characters] of a text: headers decide the most


_kept: dict[bytes, list[bytes]] = {}  # by the right input
_made: list[tuple[bytes, bytes]] = []  # right inputs of this case, and what was made of them


def begin() -> None:
    """Begin a case."""
    _made.clear()


def keep_made() -> None:
    """Keep what was made in this case."""
    for whole, made in _made:
        kept = _kept.setdefault(whole, [])
        if made and len(kept) < MOST_KEPT:
            kept.append(made)


def in_bytes(chance: Random, whole: bytes) -> bytes:
    """Some bytes changed, cut out, doubled, set to an extreme number, or cut off."""
    made = _in_bytes(chance, _start(chance, whole))
    _made.append((whole, made))
    return made


def in_words(chance: Random, text: str) -> bytes:
    """Some numbers or words exchanged, lines left out, doubled or moved; at times bytes."""
    whole = text.encode()
    made = _in_words(chance, _start(chance, whole).decode(errors="replace"))
    _made.append((whole, made))
    return made


def _start(chance: Random, whole: bytes) -> bytes:
    kept = _kept.get(whole)
    return chance.choice(kept) if kept and chance.random() < FROM_EARLIER else whole


def _in_bytes(chance: Random, whole: bytes) -> bytes:
    data = bytearray(whole)
    for _ in range(chance.choice((1, 1, 3, 20))):
        place = _place(chance, len(data))
        end = place + chance.choice((1, 4, 200))
        kind = chance.randrange(6)
        if kind == 0:
            data[place:end] = chance.randbytes(end - place)
        elif kind == 1 and data:
            data[place % len(data)] ^= 1 << chance.randrange(8)
        elif kind == 2:
            del data[place:end]
        elif kind == 3:
            data[place:place] = data[place:end]
        elif kind == 4:
            size, order = chance.choice((1, 2, 4, 8)), chance.choice(("little", "big"))
            number = chance.choice(NUMBERS) % 2 ** (8 * size)
            data[place : place + size] = number.to_bytes(size, order)  # type: ignore[arg-type]
        elif chance.random() < 0.3:
            del data[place:]
    return bytes(data)


def _in_words(chance: Random, text: str) -> bytes:
    for _ in range(chance.choice((1, 1, 1, 1, 2, 5))):
        text = _moved(chance, text) if chance.random() < 0.15 else _exchanged(chance, text)
    data = text.encode("utf-8", "surrogatepass")
    return _in_bytes(chance, data) if chance.random() < 0.1 else data


def number(chance: Random, unit: str = "") -> str:
    """A number of any size, or a text that is none."""
    value = f"{10 ** chance.uniform(-6, 6):.3g}" if chance.random() < 0.6 else chance.choice(EXTREMES)
    return value + unit


def _place(chance: Random, length: int) -> int:
    place = chance.randrange(max(1, length))
    return min(place, chance.randrange(HEAD)) if chance.random() < 0.3 else place


def _exchanged(chance: Random, text: str) -> str:
    found = list(re.finditer(r"-?\d+(?:\.\d+)?(?:e-?\d+)?|\w+|\n", text))
    if not found:
        return text
    near = [one for one in found if one.start() < HEAD] if chance.random() < 0.3 else found
    one = chance.choice(near or found)
    if one[0][0] in "-0123456789" and chance.random() < 0.6:  # another number that may be taken
        put = f"{float(one[0]) * 10 ** chance.choice((0, 0, chance.uniform(-3, 3))) + chance.gauss(0, 1e-3):.6g}"
        if one[0].isdigit() and chance.random() < 0.7:
            put = str(chance.choice((0, 1, 2, int(one[0]) + 1, int(one[0]) * 10, chance.randrange(100))))
    else:
        put = (chance.choice(EXTREMES), chance.choice(found)[0], "", 2 * one[0])[chance.randrange(4)]
    return text[: one.start()] + put + text[one.end() :]


def _moved(chance: Random, text: str) -> str:
    lines = text.splitlines(keepends=True)
    if len(lines) > 1:
        line = lines.pop(chance.randrange(len(lines)))
        lines.insert(chance.randrange(len(lines) + 1), line)
    return "".join(lines)
