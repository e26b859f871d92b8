"""Which column of a table is which, and in which unit: by its name, or as the user states it."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache

from rigtwin.lab.errors import BadInput, BadQuantity
from rigtwin.lab.tracked.table import Table
from rigtwin.lab.units import si

# names of columns by role, in lower case with single spaces; the earlier pattern is the better name
ROLES: dict[str, tuple[str, ...]] = {
    "t": ("t", "time|times|zeit|temps|tiempo|tempo", "position t", "elapsed(?: time)?|time ?stamp"),
    "frame": ("frame|frames|frame (?:number|no|nr|index)", "slice(?: n.*)?", "image|picture|bild", "step|f"),
    "x": (
        "x",
        "position x|x position|pos x|x pos",
        "(?:centroid|center|centre) x|x (?:centroid|center|centre|coord.*)",
        "cx|xm|x m",
    ),
    "y": (
        "y",
        "position y|y position|pos y|y pos",
        "(?:centroid|center|centre) y|y (?:centroid|center|centre|coord.*)",
        "cy|ym|y m",
        "height|h",
        "position|vertical position|z",
    ),
    "sigma": ("sigma|std|standard deviation|ep",),
    "id": (
        "track id",
        "particle|body",
        "trajectory|track|track n.*|object|bead|marker",
        "drop|trial|run",
        "id|label|name",
    ),
    "height": ("height|h|level|surface|bed height", "y|position y"),
    "angle": (
        "angle|alpha|theta|plate angle|tilt(?: angle)?|inclination|winkel|slope angle",
        "angle of repose.*",
        "slope",
    ),
    "left": (".*\\bleft", "remaining.*|.*remaining"),
    "collected": ("(?:.*(?:collected|discharged|outflow))|mass|weight|balance", "beads|particles|count|number"),
    "flow": ("(?:mass |volume )?flow(?: rate)?|.*(?:mass|particle) flow(?: rate)?|mass rate|discharge rate",),
}

# word beside x or y by which the column is no coordinate of a body
NO_BODY = re.compile(
    r"velocity|speed|accel|force|momentum|error|err\b|std|sigma|flag|min|max|size|start|displacement|"
    r"component|field|variance|weight|uncertainty"
)

BODIES = (  # x1, xA; x_left, x.2; ball x, Trajectory 1/0/X
    r"(?P<axis>[xyXY])[\s_]?(?P<body>\d+|[A-Z])",
    r"(?P<axis>[xyXY])[\s_./](?P<body>.+)",
    r"(?P<body>.+)[\s_./](?P<axis>[xyXY])",
)

ALIASES = {
    "pixel": "px", "pixels": "px", "pix": "px", "pxl": "px", "frames": "frame", "slice": "frame",
    "sec": "s", "secs": "s", "second": "s", "seconds": "s", "sek": "s", "msec": "ms", "milliseconds": "ms",
    "micron": "um", "microns": "um", "µm": "um", "μm": "um", "inches": "inch", "in": "inch",
    "meter": "m", "meters": "m", "metre": "m", "metres": "m", "degrees": "deg", "degree": "deg", "°": "deg",
    "radians": "rad", "grams": "g", "%": "percent",
}  # fmt: skip

# units that a header may hold without brackets; pint knows many words that are names of columns
PLAIN = {
    "px", "frame", "s", "ms", "us", "min", "m", "cm", "mm", "um", "nm", "dm", "km", "inch", "ft", "deg", "rad",
    "kg", "g", "mg", "percent",
}  # fmt: skip


@dataclass(frozen=True)
class Column:
    """One column that was understood."""

    index: int
    name: str  # as the file has it
    unit: str  # "" where neither file nor user states one


def is_unit(text: str) -> bool:
    """Return whether a word is a unit that stands in headers of tracked data.

    Parameters
    ----------
    text : str
        Word from a header.

    Returns
    -------
    bool
        True for a unit.
    """
    return _alias(text) in PLAIN


def _alias(unit: str) -> str:
    return ALIASES.get(unit.strip().lower(), unit.strip())


def role_of(header: str, roles: Sequence[str] = tuple(ROLES)) -> tuple[str, str, int]:
    """Return the role of a column by its header.

    Parameters
    ----------
    header : str
        Header of the column.
    roles : sequence of str
        Roles that are looked for.

    Returns
    -------
    role : str
        Empty for none.
    unit : str
        Unit in the header; empty for none.
    rank : int
        Rank of the match, 0 for the best name.

    Examples
    --------
    >>> role_of("x [mm]"), role_of("Position_X"), role_of("Latest: Time (s)")
    (('x', 'mm', 0), ('x', '', 1), ('t', 's', 1))
    """
    name, unit = name_and_unit(header)
    plain = _normal(name)
    for role in roles:
        for rank, pattern in enumerate(ROLES[role]):
            if re.fullmatch(pattern, plain):
                return role, unit, rank
    return "", unit, 0


@cache
def name_and_unit(header: str) -> tuple[str, str]:
    """Split a header into name and unit.

    Parameters
    ----------
    header : str
        Header of the column.

    Returns
    -------
    name, unit : str
        The unit is empty where there is none.

    Examples
    --------
    >>> [name_and_unit(text) for text in ("x_mm", "Position (m)", "t/s", "x, px", "fraction_left", "x1 [pixel]")]
    [('x', 'mm'), ('Position', 'm'), ('t', 's'), ('x', 'px'), ('fraction_left', ''), ('x1', 'px')]
    """
    text = re.sub(r"^(?:Latest|Data Set[^:]*|Run[^:]*|Video Analysis[^:]*):\s*", "", header.strip())
    if bracketed := re.fullmatch(r"(.*?)[\s_]*[(\[]([^)\]]*)[)\]]\s*", text):
        return bracketed[1], _alias(bracketed[2])
    if plain := re.fullmatch(r"(.*?)(?:\s*/\s*|\s*,\s*|\s+in\s+|[_\s])([^\s/,_]+)", text):
        unit = _alias(plain[2])
        if unit in PLAIN and plain[1]:
            return plain[1], unit
    return text, ""


def _normal(name: str) -> str:
    return re.sub(r"[\s_.\-]+", " ", name).strip().lower()


def body_and_axis(header: str) -> tuple[str, str] | None:
    """Return body and axis of a column that holds one of several bodies.

    Parameters
    ----------
    header : str
        Header of the column.

    Returns
    -------
    tuple of str or None
        Body and axis; None for any other column.

    Examples
    --------
    >>> body_and_axis("X1"), body_and_axis("y_A [mm]"), body_and_axis("Trajectory 1/0/X"), body_and_axis("X Velocity")
    (('1', 'x'), ('A', 'y'), ('Trajectory 1/0', 'x'), None)
    """
    name = name_and_unit(header)[0].strip()
    for pattern in BODIES:
        if (found := re.fullmatch(pattern, name)) and not NO_BODY.search(found["body"].lower()):
            return (found["body"], found["axis"].lower()) if not role_of(header)[0] else None
    return None


def parse_columns(text: str, *, name: str = "columns") -> Mapping[str, tuple[str, str]]:
    """Read which columns the user states.

    Parameters
    ----------
    text : str
        ``"t=time[ms],x=cx,y=cy"``.
    name : str
        The setting that errors name.

    Returns
    -------
    mapping of str to tuple of str
        By role the name (or number from 1) of its column and its unit.

    Raises
    ------
    BadQuantity
        If the text is not like this.

    Examples
    --------
    >>> parse_columns("t=2[ms], y=Hoehe")
    {'t': ('2', 'ms'), 'y': ('Hoehe', '')}
    """
    mapped: dict[str, tuple[str, str]] = {}
    for part in re.split(r"[,;]\s*(?=[a-zA-Z]+\s*=)", text.strip()):
        role, equals, column = (each.strip() for each in part.partition("="))
        role = {"time": "t", "body": "id", "particle": "id"}.get(role.lower(), role.lower())
        found = re.fullmatch(r"(.+?)\s*(?:\[([^\]]*)\])?", column)
        if not equals or found is None or role not in ROLES:
            raise BadQuantity(
                f"{name}: {part.strip()!r} names no column; write it like 't=time[ms],x=cx,y=cy' "
                f"(known are {', '.join(ROLES)})."
            )
        mapped[role] = found[1], _alias(found[2] or "")
    return mapped


def parse_joined(texts: Sequence[str], *, name: str = "join") -> tuple[tuple[str, ...], ...]:
    """Read which tracks are parts of one body.

    Parameters
    ----------
    texts : sequence of str
        ``"3,7"``: the parts of one broken track; once for each body.
    name : str
        The setting that errors name.

    Returns
    -------
    tuple of tuple of str
        The names of the parts, for each body.

    Raises
    ------
    BadQuantity
        If a text names fewer than two, or one twice.
    """
    groups = tuple(tuple(part.strip() for part in text.split(",") if part.strip()) for text in texts)
    if any(len(set(group)) < max(2, len(group)) for group in groups):
        raise BadQuantity(f"{name}: name the parts of a broken track like '3,7', two at least and each once.")
    return groups


def find_column(table: Table, role: str, stated: Mapping[str, tuple[str, str]]) -> Column | None:
    """Return the column of a role: the stated one, else that with the best name.

    Parameters
    ----------
    table : Table
        Table whose columns are searched.
    role : str
        Role that the column plays, one of `ROLES`.
    stated : mapping of str to tuple of str
        What the user states, as of `parse_columns`.

    Returns
    -------
    Column or None
        None if there is none.

    Raises
    ------
    BadInput
        If a stated column is not there or two columns have the name.
    """
    if role in stated:
        wanted, unit = stated[role]
        at = [k for k, name in enumerate(table.names) if wanted in (name, name_and_unit(name)[0])]
        if not at and wanted.isdigit() and 1 <= int(wanted) <= len(table.names):
            at = [int(wanted) - 1]
        if not at:
            raise BadInput(f"{table.path}: there is no column {wanted!r} for {role}; {found_columns(table)}.")
        return column_at(table, at[0], unit)
    claimed = {name for name, _ in stated.values()}
    ranked = sorted(
        (rank, k)
        for k, name in enumerate(table.names)
        for found, _, rank in [role_of(name, [role])]
        if found and name not in claimed and (role != "id" or _repeats(table, k))
    )
    if not ranked:
        return None
    same = [k for rank, k in ranked if rank == ranked[0][0] and table.titles[k] == table.titles[ranked[0][1]]]
    if len(same) > 1:
        names = " and ".join(repr(table.names[k]) for k in same)
        twice = "stands there twice" if len({table.names[k] for k in same}) == 1 else "may each be meant"
        raise BadInput(f"{table.path}: the column {role}: {names} {twice}; name one with --columns '{role}=NAME'.")
    return column_at(table, ranked[0][1])


def _repeats(table: Table, index: int) -> bool:
    """Whether a column names bodies: fewer names than rows."""
    cells = [row[index] for row in table.rows]
    return len(set(cells)) <= max(1, len(cells) // 2) or not all(cell.isdigit() for cell in cells)


def column_at(table: Table, index: int, unit: str = "") -> Column:
    """Return a column by its index.

    Parameters
    ----------
    table : Table
        Table that holds the column.
    index : int
        Its index, from 0.
    unit : str
        Its unit; empty: the one that the file states for it.

    Returns
    -------
    Column
        The column.
    """
    in_name = name_and_unit(table.names[index])[1]
    return Column(index, table.names[index], unit or in_name or _alias(table.units[index]))


def factor(table: Table, column: Column, dimension: str) -> float:
    """Return what a value of a column is multiplied by to be in SI.

    Parameters
    ----------
    table : Table
        The table, for messages.
    column : Column
        Column whose values are converted.
    dimension : str
        One of `rigtwin.lab.units.DIMENSIONS`.

    Returns
    -------
    float
        The factor.

    Raises
    ------
    BadInput
        If the unit is of another dimension.
    """
    try:
        return si(f"1 {column.unit}", dimension, name="unit")
    except BadQuantity:
        raise BadInput(
            f"{table.path}: the column {column.name!r} is in {column.unit!r}, which is no unit of {dimension}; "
            "state it with --columns 't=time[ms]'."
        ) from None


def found_columns(table: Table) -> str:
    """Return what a refusal says of the columns that were seen.

    Parameters
    ----------
    table : Table
        Table whose columns are listed.

    Returns
    -------
    str
        A clause.
    """
    return f"the columns are {', '.join(repr(name) for name in table.names)}"
