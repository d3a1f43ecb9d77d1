"""A text with citations, as plain text with a list of references, or as LaTeX with BibTeX."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

from palpate_kit.terminal.layout import latex_text

from palpate_report.bibliography import bibtex_of, references

_CITED = re.compile(" ?\ue000([\\w,]+)\ue001")  # private characters, which no printable text has


def cite(keys: Sequence[str]) -> str:
    """Return the mark of a citation within a text; nothing where nothing is cited."""
    return f" \ue000{','.join(keys)}\ue001" if keys else ""


@dataclass(frozen=True)
class CitedText:
    """Paragraphs by their headings, with marks of citations in them."""

    paragraphs: dict[str, str]

    @property
    def keys(self) -> list[str]:
        """Keys of the cited works, in their order."""
        whole = " ".join(self.paragraphs.values())
        return list(dict.fromkeys(key for match in _CITED.finditer(whole) for key in match[1].split(",")))

    @property
    def plain(self) -> str:
        """Plain text with numbered citations and a list of references."""
        numbers = {key: str(number) for number, key in enumerate(self.keys, start=1)}
        parts = [
            f"{heading}\n\n{_CITED.sub(lambda m: f' [{_numbered(m[1], numbers)}]', text)}"
            for heading, text in self.paragraphs.items()
        ]
        works = [f"[{numbers[key]}] {references()[key].text}" for key in self.keys]
        return "\n\n".join([*parts, "References", "\n".join(works)]) + "\n"

    @property
    def latex(self) -> str:
        """LaTeX that another document includes."""
        head = "% \\input{methods} in a document with \\bibliography{methods}; in UTF-8\n"
        return head + "".join(
            f"\n\\subsection*{{{latex_text(heading)}}}\n{_latex(text)}\n" for heading, text in self.paragraphs.items()
        )

    @property
    def bibtex(self) -> str:
        """BibTeX entries of the cited works."""
        return bibtex_of(self.keys)


def _numbered(keys: str, numbers: dict[str, str]) -> str:
    return ", ".join(numbers[key] for key in keys.split(","))


def _latex(text: str) -> str:
    parts = _CITED.split(text)  # every second one is keys
    return "".join(f"~\\cite{{{part}}}" if place % 2 else latex_text(part) for place, part in enumerate(parts))
