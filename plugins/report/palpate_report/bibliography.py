"""The references of a methods section, by the sources of models, as BibTeX and as plain text."""

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
        fields = {name: re.sub(r"[{}]", "", text).replace("--", "\N{EN DASH}") for name, text in self.fields.items()}
        authors = ", ".join(map(_short_name, fields["author"].split(" and ")))
        where = fields.get("journal") or fields.get("publisher") or fields["institution"]
        # " 12(3)" of a journal; ", E251" of a standard or a report, which has a number and no volume.
        volume = f", {fields['number']}" if "number" in fields else ""
        if "volume" in fields:
            issue = f"({fields['number']})" if "number" in fields else ""
            volume = f" {fields['volume']}{issue}"
        pages = f", {fields['pages']}" if "pages" in fields else ""
        doi = f", doi:{fields['doi']}" if "doi" in fields else ""
        return f"{authors} ({fields['year']}). {fields['title']}. {where}{volume}{pages}{doi}."


def _short_name(author: str) -> str:
    """Return surname and initials.

    >>> _short_name("Popov, Valentin L."), _short_name("Joint Committee for Guides in Metrology")
    ('Popov VL', 'Joint Committee for Guides in Metrology')
    """
    surname, comma, first_names = author.partition(", ")
    return f"{surname} {''.join(name[0] for name in first_names.replace('-', ' ').split())}" if comma else author


@cache
def references() -> dict[str, CitedWork]:
    """Return every reference by its key."""
    text = files("palpate_report").joinpath("references.bib").read_text(encoding="utf-8")
    works = {}
    for match in _ENTRY.finditer(text):
        fields = {field["name"]: field["text"] for field in _FIELD.finditer(match["fields"])}
        bibtex = re.sub(r",\n  sources = \{.*\}\n", "\n", match[0])
        works[match["key"]] = CitedWork(match["key"], bibtex, fields)
    return works


def keys_of(sources: str) -> tuple[str, ...]:
    """Return the references that a text on sources names, in the order in which it names them."""
    places = {key: sources.find(reference.fields["sources"]) for key, reference in references().items()}
    return tuple(sorted((key for key, place in places.items() if place >= 0), key=lambda key: places[key]))


def sources_of(part: type) -> str:
    """Return the source in the docstring of a model, tip or estimator; empty without one."""
    match = _SOURCE.search(part.__doc__ or "")
    return " ".join(match[1].split()) if match else ""


def bibtex_of(keys: Sequence[str]) -> str:
    """Return the entries of some references."""
    return "\n\n".join(references()[key].bibtex for key in sorted(keys)) + "\n"
