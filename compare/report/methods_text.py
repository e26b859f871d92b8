"""A methods text: paragraphs in Markdown, their citations, and the page's and the .bib file's form of both.

`Methods.markdown` is in Pandoc's Markdown, whose ``[@key]`` refer to ``references.bib``.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from html import escape

from rigtwin.lab.formatting import counted
from rigtwin.lab.reference.bibliography import Reference, bibtex, cited, reference, references

_CITATION = re.compile(r"\[((?:@\w+(?:; )?)+)\]")


@dataclass(frozen=True)
class Methods:
    """Paragraphs with their headings, in Markdown."""

    paragraphs: tuple[tuple[str, str], ...]

    @property
    def cited(self) -> list[Reference]:
        """The references in the order in which the text cites them."""
        found = [key for _, text in self.paragraphs for group in _CITATION.findall(text) for key in _keys(group)]
        return [reference(key) for key in dict.fromkeys(found)]

    @property
    def markdown(self) -> str:
        """The whole text, its list of references at the end."""
        parts = ["# Methods", *(f"## {heading}\n\n{text}" for heading, text in self.paragraphs), "## References"]
        listed = [f"- `{one.key}`: {one.in_words} {one.address}".rstrip() for one in self.cited]
        return "\n\n".join([*parts, "\n".join(listed)]) + "\n"

    @property
    def html(self) -> list[tuple[str, list[str]]]:
        """Each heading with its paragraphs as HTML."""
        return [(heading, [_as_html(part) for part in text.split("\n\n")]) for heading, text in self.paragraphs]

    def files(self, page: str) -> dict[str, str]:
        """Return the files of the text, for `result_files.write_together`.

        Parameters
        ----------
        page : str
            Name of the page.

        Returns
        -------
        dict of str to str
            Content of ``PAGE-methods.md`` and ``PAGE-references.bib``.
        """
        return {f"{page}-methods.md": self.markdown, f"{page}-references.bib": self.bibtex}

    @property
    def bibtex(self) -> str:
        """The content of ``references.bib``."""
        return bibtex([one.key for one in self.cited])


def software(versions: Mapping[str, str]) -> str:
    """Return the sentence on versions of programs.

    Parameters
    ----------
    versions : mapping of str to str
        Versions by name.

    Returns
    -------
    str
        The sentence.
    """
    names = {"python": "Python", "opencv-python-headless": "OpenCV", "av": "PyAV"}
    return f"Versions: {', '.join(f'{names.get(name, name)} {version}' for name, version in versions.items())}."


def listed(words: Iterable[str]) -> str:
    """Return words as a list in a sentence.

    Parameters
    ----------
    words : iterable of str
        At least one.

    Returns
    -------
    str
        The list.

    Examples
    --------
    >>> listed(["a"]), listed(["a", "b", "c"])
    ('a', 'a, b and c')
    """
    *first, last = words
    return f"{', '.join(first)} and {last}" if first else last


def were(number: int, what: str) -> str:
    """Return a number of things with the verb of the passive voice that follows.

    Parameters
    ----------
    number, what : int, str
        As for `counted`.

    Returns
    -------
    str
        The words.
    """
    return f"{counted(number, what)} {'were' if number != 1 else 'was'}"


def effect_sentence(title: str, equation: str, source: str, numbers: str = "") -> str:
    """Return the sentence on an effect, with its source as citation where the bibliography has it.

    Parameters
    ----------
    title, equation, source : str
        As of `rigtwin.sim.effects.Effect`.
    numbers : str
        Values of its coefficients, in words.

    Returns
    -------
    str
        The sentence.
    """
    keys = "; ".join(f"@{key}" for key in cited(source))
    return f"Effect {title}: {equation}{numbers} {f'[{keys}]' if keys else f'({source})'}."


def _keys(group: str) -> list[str]:
    """Keys of a group of citations; what looks like one in a name of the lab is none."""
    return [key for key in (one.strip("@ ") for one in group.split(";")) if key in references()]


def _as_html(text: str) -> str:
    """A paragraph as HTML: names as code, citations as links to the list of references."""

    def links(found: re.Match[str]) -> str:
        keys = _keys(found[1])
        shown = "; ".join(f'<a href="#ref-{key}">{escape(reference(key).short)}</a>' for key in keys)
        return f"({shown})" if keys else found[0]

    return _CITATION.sub(links, re.sub(r"`([^`]*)`", r"<code>\1</code>", escape(text)))
