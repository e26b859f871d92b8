"""Papers and books that the models and methods come from, as BibTeX and as text.

They stand in ``references.bib``, each under a key of first author and year.
"""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from importlib import resources

from rigtwin.lab.version import RELEASED, __version__

SOFTWARE = "rigtwin"
"""Key of rigtwin itself."""


@dataclass(frozen=True)
class Reference:
    """One paper, book or program."""

    key: str
    bibtex: str
    fields: Mapping[str, str]

    @property
    def authors(self) -> list[tuple[str, str]]:
        """Last and first names; a group has a last name only."""
        names = (name.strip("{} ") for name in self.fields["author"].split(" and "))
        parts = (name.partition(", ") for name in names)
        return [(last, first) for last, _, first in parts]

    @property
    def short(self) -> str:
        """Authors and year, as in the text of a paper.

        Returns
        -------
        str
            The words.

        Examples
        --------
        >>> reference("hlosta2020").short, reference("brown2003").short, reference("zener1941").short
        ('Hlosta et al. 2020', 'Brown and Lawler 2003', 'Zener 1941')
        """
        names = [last for last, _ in self.authors]
        if len(names) > 2:
            names = [f"{names[0]} et al."]
        return f"{' and '.join(names)} {self.fields['year']}"

    @property
    def in_words(self) -> str:
        """The entry of a list of references.

        Returns
        -------
        str
            The words.

        Examples
        --------
        >>> reference("johnson1985").in_words
        'K. L. Johnson, Contact Mechanics. Cambridge University Press (1985).'
        """
        names = [" ".join(filter(None, (_initials(first), last))) for last, first in self.authors]
        has = {name: _plain(value) for name, value in self.fields.items()}
        number = f"({has['number']})" if "number" in has and "volume" in has else ""
        where = " ".join(filter(None, (has.get("journal", ""), has.get("volume", "") + number)))
        where = ", ".join(filter(None, (where, has.get("pages", ""))))
        report = has.get("number") if "institution" in has else None
        made = (_edition(has), has.get("publisher"), has.get("howpublished"), has.get("version"), report)
        place = where or ", ".join(filter(None, made))
        return f"{', '.join(names)}, {has['title']}. {place} ({has['year']})."

    @property
    def address(self) -> str:
        """Where it is found; empty if it has no DOI."""
        return f"https://doi.org/{self.fields['doi']}" if "doi" in self.fields else ""


@cache
def references() -> dict[str, Reference]:
    """All references by key, rigtwin itself the first."""
    text = resources.files(__package__).joinpath("references.bib").read_text(encoding="utf-8")
    entries = [_software(), *re.findall(r"^@\w+\{.*?^\}$", text, re.MULTILINE | re.DOTALL)]
    found = [
        Reference(_key(entry), entry, dict(re.findall(r"^  (\w+) = \{(.*)\},$", entry, re.MULTILINE)))
        for entry in entries
    ]
    return {one.key: one for one in found}


def reference(key: str) -> Reference:
    """Return the reference of a key.

    Parameters
    ----------
    key : str
        Key of the bibliography.

    Returns
    -------
    Reference
        The reference.

    Raises
    ------
    KeyError
        If there is none.
    """
    return references()[key]


def cited(source: str) -> Iterator[str]:
    """Yield the references that a text names by first author and year.

    Parameters
    ----------
    source : str
        The text, its parts separated by semicolons.

    Yields
    ------
    str
        Their keys.

    Examples
    --------
    >>> list(cited("Batchelor 1967, section 6.8; Clift, Grace & Weber 1978; measured"))
    ['batchelor1967', 'clift1978']
    """
    for part in source.split(";"):
        for key, one in references().items():
            names = [_ascii(last) for last, _ in one.authors]
            found = re.search(rf"{re.escape(names[0])}\b[^\d]*\b{one.fields['year']}\b", _ascii(part))
            # of two papers with the same first author and year the other authors decide
            if key != SOFTWARE and found and (len(names) > 2 or all(name in _ascii(part) for name in names)):
                yield key


def bibtex(keys: Iterator[str] | list[str]) -> str:
    """Return the text of a .bib file.

    Parameters
    ----------
    keys : iterable of str
        Keys of the references, each of which stands there once.

    Returns
    -------
    str
        The text.

    Raises
    ------
    KeyError
        If there is no such reference.
    """
    return "\n\n".join(reference(key).bibtex for key in dict.fromkeys(keys)) + "\n"


def _software() -> str:
    fields = {
        "author": "{The rigtwin authors}",
        "title": "rigtwin: granular-material experiments measured from media, and their digital twins",
        "year": RELEASED[:4],
        "version": __version__,
        "note": "MIT licence",
    }
    return "\n".join((f"@software{{{SOFTWARE},", *(f"  {name} = {{{value}}}," for name, value in fields.items()), "}"))


def _key(entry: str) -> str:
    return entry.partition("{")[2].partition(",")[0]


def _ascii(words: str) -> str:
    return unicodedata.normalize("NFKD", words).encode("ascii", "ignore").decode()


def _initials(first: str) -> str:
    """``Jin Y.`` as ``J. Y.``, ``Jian-Fei`` as ``J.-F.``"""
    return " ".join("-".join(f"{part[0]}." for part in name.split("-")) for name in first.split())


def _plain(value: str) -> str:
    return re.sub(r"[{}]", "", value).replace(" -- ", " – ").replace("--", "–")


def _edition(has: Mapping[str, str]) -> str:
    endings = {"2": "2nd", "3": "3rd"}
    return f"{endings[has['edition']]} ed." if "edition" in has else ""
