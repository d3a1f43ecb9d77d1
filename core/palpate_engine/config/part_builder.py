"""The builder: tables become parts; a part named in another part's table is found, or built in place."""

from __future__ import annotations

from contextlib import suppress
from typing import Any

from palpate import hooks
from palpate.claims import CORE_TABLES
from palpate.errors import RAISED_BY_PARTS, PalpateError, PluginError, error_in, suggest
from palpate.key_mistakes import Location, Mistake, mistakes_of
from palpate.parts import Part, Settings, nested_settings, part_kind, table_of_parts
from palpate.registry import Registry
from pydantic import ValidationError

from palpate_engine.config.file_version import KEY
from palpate_engine.config.pipeline_source import Source
from palpate_engine.config.unit_plausibility import UNCHECKED, implausible_units


class _PartError(Exception):
    """A part that another one needs cannot be built; its own mistakes are noted."""


def _short(name: str) -> str:
    """Return a name of one word for a table."""
    return name.replace("-", "_")


class Builder:
    """Builds the parts of one pipeline file and collects what is wrong with it."""

    def __init__(self, source: Source, registry: Registry) -> None:
        self.mistakes: list[Mistake] = []
        self._tables = source.tables
        self._registry = registry
        self._context = {"base": source.path.parent, "enclosure": source.enclosure}
        self._built: dict[Location, Part | None] = {}
        self._begun: set[Location] = set()  # parts that are being built: one that needs such a part needs itself

    def parts(self, kind: str) -> dict[str, Any]:
        """Return every part of a kind that the file names and that is in order."""
        tables = self._tables.get(kind, {})
        if not isinstance(tables, dict):
            self._note((kind,), f"is not a table: name each {kind}, as in [{kind}.my_{kind}]")
            return {}
        if isinstance(tables.get("type"), str):
            self._note((kind,), f"has no name: write [{kind}.NAME], such as [{kind}.{_short(tables['type'])}]")
            return {}
        parts = {}
        for name in tables:
            part = self._named(kind, name)
            if part is not None:
                parts[name] = part
        return parts

    def settings(self, settings: type[Settings], location: Location) -> Any:
        """Return the settings of one plain table, or None where they are not in order."""
        table = self._tables.get(location[0], {})
        try:
            return self._validated(settings, table, location)
        except _PartError:
            return None

    def _note(self, location: Location, problem: str) -> None:
        self.mistakes.append(Mistake(location, problem))

    def _named(self, kind: str, name: str) -> Part | None:
        """Return the part of a table with a name, built once; None where it is not in order, which has been noted."""
        location = (kind, name)
        if location not in self._built:
            self._built[location] = None
            self._begun.add(location)
            with suppress(_PartError):
                self._built[location] = self._part(kind, self._tables[kind][name], location)
            self._begun.remove(location)
        return self._built[location]

    def _part(self, kind: str, table: Any, location: Location) -> Part:
        """Return the part of a table by its `type`.

        Raises _PartError where it is not in order, which has been noted.
        """
        if not isinstance(table, dict) or not isinstance(table.get("type"), str):
            types = ", ".join(sorted(self._registry.parts[kind]))
            self._note(location, f'needs type = "..." (there are: {types})')
            raise _PartError
        try:
            part_class = self._registry.find(kind, table["type"])
        except PluginError as error:
            self._note((*location, "type"), str(error))
            raise _PartError from error
        settings = {key: value for key, value in table.items() if key != "type"}
        built = self._validated(part_class, settings, location)
        assert isinstance(built, Part)
        return built

    def _validated(self, settings: type[Settings], table: Any, location: Location) -> Settings:
        """Return the settings of a table, an object of the class `settings`, with the parts that its keys name or hold.

        Raises _PartError where they are not in order; what is wrong has been noted.
        """
        broken: set[Location] = set()
        doubted: list[Mistake] = []
        if isinstance(table, dict):
            table = dict(table)
            doubted = self._doubted(settings, table, location)
            broken = self._build_inner(settings, table, location)
        try:
            part = settings.model_validate(table, context=self._context)
        except ValidationError as error:
            # That a broken inner table is missing now is not a mistake of its own.
            wrong = mistakes_of(error, settings, location)
            self.mistakes += [mistake for mistake in wrong if mistake.location not in broken]
            wrong_places = {mistake.location for mistake in wrong}
            self.mistakes += [mistake for mistake in doubted if mistake.location not in wrong_places]
            raise _PartError from error
        except PalpateError as error:  # a part that looks into its file
            self._note(location, str(error))
            raise _PartError from error
        except RAISED_BY_PARTS as error:  # whatever a third party's validator raises
            self._note(location, f"{settings.__name__} failed: {error_in(error)}")
            raise _PartError from error
        if not isinstance(part, settings):
            self._note(location, f"a validator of {settings.__name__} returns {part!r}, not the part itself")
            raise _PartError
        self.mistakes += doubted
        if doubted or broken:  # what is in order without its broken inner table is another part than was meant
            raise _PartError
        return part

    def _build_inner(self, settings: type[Settings], table: dict[str, Any], location: Location) -> set[Location]:
        """Put parts in place of what a table says of them; take out the broken ones and return their places."""
        broken = set()
        for name in settings.model_fields.keys() & table.keys():
            try:
                table[name] = self._inner(settings.model_fields[name].annotation, table[name], (*location, name))
            except _PartError:
                broken.add((*location, name))
                del table[name]
        return broken

    def _doubted(self, settings: type[Settings], table: dict[str, Any], location: Location) -> list[Mistake]:
        """Return a mistake for each number without a unit that was hardly meant, in a table for a class of settings.

        The key `unchecked`, whose numbers are meant, is taken out of the table.
        """
        if UNCHECKED in settings.model_fields:
            return []
        unchecked = table.pop(UNCHECKED, [])
        if not isinstance(unchecked, list) or not all(isinstance(name, str) for name in unchecked):
            return [Mistake((*location, UNCHECKED), 'must be a list of keys, such as ["bias"]')]
        unknown = [name for name in unchecked if name not in settings.model_fields]
        wrong = [f"unknown key {name!r}{suggest(name, settings.model_fields)}" for name in unknown]
        mistakes = [Mistake((*location, UNCHECKED), problem) for problem in wrong]
        for name, doubt in implausible_units(settings, table).items():
            if name not in unchecked:
                mistakes.append(Mistake((*location, name), doubt))
        return mistakes

    def _inner(self, annotation: Any, value: Any, location: Location) -> Any:
        """Return a field's value: what asks for a part gets one, by its name or from a table in place."""
        # Several parts by name, settings in place, one part in place, or the name of one.
        kind = part_kind(annotation)
        entry = table_of_parts(annotation)
        if entry is not None and isinstance(value, dict):
            return {name: self._inner(entry, item, (*location, name)) for name, item in value.items()}
        nested = nested_settings(annotation)
        if kind is None or (nested and isinstance(value, dict) and "type" not in value):
            return self._validated(nested, value, location) if nested and isinstance(value, dict) else value
        if isinstance(value, dict):
            return self._part(kind, value, location)
        if isinstance(value, str):
            return self._part_of_name(kind, value, location)
        self._note(location, f"must name a [{kind}.*] table or be one")
        raise _PartError

    def _part_of_name(self, kind: str, name: str, location: Location) -> Part:
        """Return the part of the table [kind.name], which the key at a location names.

        Raises _PartError where it is missing, broken or needs itself, which has been noted.
        """
        names = self._tables.get(kind, {})
        if not isinstance(names, dict) or name not in names:
            self._note(location, f"no [{kind}.{name}]{suggest(name, names)}")
            raise _PartError
        if (kind, name) in self._begun:
            self._note(location, f"[{kind}.{name}] needs itself")
            raise _PartError
        part = self._named(kind, name)
        if part is None:
            raise _PartError
        return part


def unknown_tables(tables: dict[str, Any], registry: Registry) -> list[Mistake]:
    """Return a mistake for every top-level table that neither the core nor a plugin knows."""
    allowed = (*CORE_TABLES, *registry.tables, *hooks.PART_KINDS)
    unknown = [name for name in tables if name not in (*allowed, KEY)]
    return [Mistake((name,), f"unknown table{suggest(name, allowed)}") for name in unknown]
