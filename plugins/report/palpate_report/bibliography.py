"""The references of a methods section: what the sources of models are called, as BibTeX and as plain text."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from importlib.resources import files

_ENTRY = re.compile(r"^@\w+\{(?P<key>\w+),\n(?P<fields>.*?)^\}$", re.MULTILINE | re.DOTALL)
_FIELD = re.compile(r"^  (?P<name>\w+) = \{(?P<text>.*)\},?$", re.MULTILINE)
_SOURCE = re.compile(r"Source: (.*?)(?:\n\s*\n|$)", re.DOTALL)


@dataclass(frozen=True)
class CitedWork:
    """A work that is cited."""

    key: str
    bibtex: str
    fields: dict[str, str]

    @property
    def text(self) -> str:
        """Author, title and place in one line."""
        known = {name: re.sub(r"[{}]", "", text).replace("--", "\N{EN DASH}") for name, text in self.fields.items()}
        authors = ", ".join(map(_short_name, known["author"].split(" and ")))
        where = known.get("journal") or known.get("publisher") or known["institution"]
        number = f"({known['number']})" if "number" in known and "volume" in known else ""
        volume = (
            f" {known['volume']}{number}" if "volume" in known else f", {known['number']}" if "number" in known else ""
        )
        pages = f", {known['pages']}" if "pages" in known else ""
        doi = f", doi:{known['doi']}" if "doi" in known else ""
        return f"{authors} ({known['year']}). {known['title']}. {where}{volume}{pages}{doi}."


def _short_name(author: str) -> str:
    """Surname and initials.

    >>> _short_name("Popov, Valentin L."), _short_name("Joint Committee for Guides in Metrology")
    ('Popov VL', 'Joint Committee for Guides in Metrology')
    """
    surname, comma, given = author.partition(", ")
    return f"{surname} {''.join(name[0] for name in given.replace('-', ' ').split())}" if comma else author


@cache
def references() -> dict[str, CitedWork]:
    """Return every reference by its key."""
    text = files("palpate_report").joinpath("references.bib").read_text(encoding="utf-8")
    found = {}
    for match in _ENTRY.finditer(text):
        fields = {field["name"]: field["text"] for field in _FIELD.finditer(match["fields"])}
        bibtex = re.sub(r",\n  sources = \{.*\}\n", "\n", match[0])
        found[match["key"]] = CitedWork(match["key"], bibtex, fields)
    return found


def keys_of(sources: str) -> tuple[str, ...]:
    """Return the references that a text on sources names, in the order in which it names them."""
    places = {key: sources.find(reference.fields["sources"]) for key, reference in references().items()}
    return tuple(sorted((key for key, place in places.items() if place >= 0), key=lambda key: places[key]))


def sources_of(part: type) -> str:
    """What the documentation of a model, tip or estimator names as its source; "" where it names none."""
    match = _SOURCE.search(part.__doc__ or "")
    return " ".join(match[1].split()) if match else ""


def bibtex_of(keys: Sequence[str]) -> str:
    """Return the entries of some references."""
    return "\n\n".join(references()[key].bibtex for key in sorted(keys)) + "\n"
