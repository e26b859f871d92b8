"""One figure of a page: its drawing, its bitmap, the numbers in it, and the files that they become.

`figure_files` gives for each figure ``figures/NAME.svg`` (text as text), ``NAME.png`` and ``NAME.csv``, and beside them
``figures/PAGE-captions.csv``, the list of the figures of a page.
"""

from __future__ import annotations

import io
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from html import escape
from typing import TYPE_CHECKING, Any

from rigtwin.compare.result_files import FIGURES, table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

DPI = 300  # [1/inch], what journals ask for at least of pictures with lines and text
PACKED = 4  # zlib's level; 9 takes three times as long for 5 % less
LONGEST = 120  # letters of a name; file systems allow 255, temporary names are longer
_UNITS = {"°": "deg", "%": "percent"}


@dataclass(frozen=True)
class FigureFile:
    """One figure."""

    name: str
    """Of its files, without the ending."""
    svg: str
    """Content of the SVG file."""
    png: bytes
    csv: str
    """The numbers drawn."""
    caption: str
    label: str
    """What it shows, for readers who cannot see it."""

    @property
    def inline(self) -> str:
        """The drawing as part of a page."""
        # a style sheet would apply to the whole page
        drawing = re.sub(r"<style.*?</style>", "", self.svg[self.svg.index("<svg") :], flags=re.DOTALL)
        return drawing.replace("<svg ", f'<svg role="img" aria-label="{escape(self.label)}" ', 1)

    @property
    def files(self) -> dict[str, str]:
        """Addresses of its files beside the page, by kind."""
        return {kind: f"{FIGURES}/{self.name}.{kind.lower()}" for kind in ("SVG", "PNG", "CSV")}


def figure_file(
    figure: Figure,
    name: str,
    label: str,
    rows: Sequence[Mapping[str, Any]],
    columns: Sequence[str] = (),
    caption: str = "",
) -> FigureFile:
    """A figure in the style of `plot_style.canvas`, whose context still holds.

    Parameters
    ----------
    figure : matplotlib.figure.Figure
        The figure.
    name : str
        Name of its files.
    label : str
        What it shows, in a few words.
    rows : sequence of mappings
        The numbers drawn.
    columns : sequence of str
        Columns of the table of these numbers, with their units; by default the keys of the first row.
    caption : str
        Its caption, by default the label.

    Returns
    -------
    FigureFile
        Drawing, bitmap and table.
    """
    drawing, bitmap = io.StringIO(), io.BytesIO()
    _lay_out(figure)
    figure.savefig(drawing, format="svg", metadata={"Date": None, "Creator": None, "Format": None, "Type": None})
    figure.savefig(
        bitmap, format="png", dpi=DPI, metadata={"Software": None}, pil_kwargs={"compress_level": PACKED}
    )  # fmt: skip
    head = columns or (tuple(rows[0]) if rows else ())
    return FigureFile(name, drawing.getvalue(), bitmap.getvalue(), table(rows, head), caption or label, label)


def _lay_out(figure: Figure) -> None:
    """Place the axes once for all files; a figure that keeps its engine is drawn once more for each of them."""
    import matplotlib

    if (engine := figure.get_layout_engine()) is not None:
        engine.execute(figure)
        with matplotlib.rc_context({"figure.autolayout": False, "figure.constrained_layout.use": False}):
            figure.set_layout_engine(None)


def figure_files(page: str, figures: Iterable[FigureFile]) -> dict[str, str | bytes]:
    """The files of all figures of a page by name, for `result_files.write_together`.

    Parameters
    ----------
    page : str
        Name of the page or of its command; the figures of another page in the same folder are left alone.
    figures : iterable of FigureFile
        Figures with different names.

    Returns
    -------
    dict of str to str or bytes
        Content by path relative to the folder of results.
    """
    found = list(figures)
    contents: dict[str, str | bytes] = {}
    for one in found:
        contents |= dict(zip(one.files.values(), (one.svg, one.png, one.csv), strict=True))
    rows = [{"figure": one.name, "caption": one.caption} for one in found]
    return {**contents, f"{FIGURES}/{page}-captions.csv": table(rows, ("figure", "caption"))}


def column_name(label: str) -> str:
    """Return the name of a column for the label of an axis.

    Parameters
    ----------
    label : str
        Label of an axis, with its unit.

    Returns
    -------
    str
        The name.

    Examples
    --------
    >>> column_name("height above the plate / mm"), column_name("restitution [1]")
    ('height_above_the_plate_mm', 'restitution')
    """
    words, _, unit = (part.strip() for part in re.sub(r"\[(.*)\]$", r"/ \1", label).rpartition(" / "))
    unit = _UNITS.get(unit, "" if unit == "1" else unit)
    return re.sub(r"\W+", "_", f"{words} {unit}" if words else unit).strip("_")


def slug(words: str) -> str:
    """Return a name of a file: letters, digits, points, hyphens and underscores.

    Parameters
    ----------
    words : str
        Any text.

    Returns
    -------
    str
        The name.

    Examples
    --------
    >>> slug("pair/1: height of the bead")
    'pair-1-height-of-the-bead'
    """
    return re.sub(r"[^\w.]+", "-", words, flags=re.ASCII)[:LONGEST].strip("-.") or "figure"


def unique_names(names: Iterable[str]) -> Iterator[str]:
    """Yield names, with a number behind those that stand there already.

    Parameters
    ----------
    names : iterable of str
        Names, some perhaps equal.

    Yields
    ------
    str
        The names, all different.

    Examples
    --------
    >>> list(unique_names(["heap", "heap", "bed"]))
    ['heap', 'heap-2', 'bed']
    """
    taken: set[str] = set()
    for name in names:
        number, one = 1, name
        while one.lower() in taken:  # some file systems do not distinguish capitals
            number += 1
            one = f"{name}-{number}"
        taken.add(one.lower())
        yield one
