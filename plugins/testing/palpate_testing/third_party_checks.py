"""Tips and third-party models are checked before anything moves: a wrong one gives plausible and wrong numbers."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import Any

from palpate import ContactModel, Indenter, Part, PluginError, Settings, to_si
from palpate_engine import Quantity, Registry

from palpate_testing.model_checks import check_force, check_parameters, usual_values
from palpate_testing.tip_checks import check_indenter


def check_parts(parts: Mapping[str, Mapping[str, Part]], registry: Registry) -> None:
    """Raise PluginError for a wrong tip, third-party model or default among parts by kind and name."""
    check_defaults([part for parts_by_name in parts.values() for part in parts_by_name.values()], registry)
    parts_with_tips = [part for group in ("indenter", "model", "device") for part in parts.get(group, {}).values()]
    check_tips(parts_with_tips, registry)
    check_models([part for part in parts.get("model", {}).values() if isinstance(part, ContactModel)], registry)


def check_defaults(parts: Iterable[Part], registry: Registry) -> None:
    """Raise PluginError for a third-party part with a quantity whose default is a text, which nobody converts."""
    for part in parts:
        entry = next((e for e in registry.parts[part.kind].values() if e.is_of(type(part))), None)
        if entry is None or entry.plugin.own:
            continue
        for key, field in type(part).model_fields.items():
            unit = next((item.unit for item in field.metadata if isinstance(item, Quantity)), None)
            if unit is None or not isinstance(field.default, str):
                continue
            try:
                problem = f"is a text; write {to_si(field.default, unit):g}, in {unit}"
            except ValueError as error:
                problem = f"is wrong: {error}"
            where = f"plugin {entry.plugin.name}: {part.kind} {entry.name!r}"
            raise PluginError(f"{where}: the default {field.default!r} of {key} {problem}")


def check_tips(parts: Iterable[Settings], registry: Registry) -> None:
    """Raise PluginError, which names plugin, part, method and depth, where a tip breaks its interface."""
    checked_ids: set[int] = set()
    for part in parts:
        for tip in _tips(part):
            if id(tip) in checked_ids:
                continue
            checked_ids.add(id(tip))
            entry = next((e for e in registry.parts["indenter"].values() if e.part is type(tip)), None)
            try:
                check_indenter(tip)
            except AssertionError as error:
                where = f"plugin {entry.plugin.name}: indenter {entry.name!r}" if entry else "indenter"
                raise PluginError(f"{where}: {error}") from error


def check_models(models: Iterable[ContactModel], registry: Registry) -> None:
    """Raise PluginError, which names plugin, part and depth, where a third-party contact model breaks its interface.

    Those of palpate's own distribution have been checked by its tests.
    """
    for model in models:
        entry = next((e for e in registry.parts["model"].values() if e.part is type(model)), None)
        if entry is None or entry.plugin.own:
            continue
        try:
            theta = usual_values(model)
            check_parameters(model, theta)
            check_force(model, theta)
        except Exception as error:  # whatever third-party code raises
            reason = str(error) if isinstance(error, AssertionError) else f"{type(error).__name__}: {error}"
            where = f"plugin {entry.plugin.name}: model {entry.name!r}"
            raise PluginError(f"{where}: {reason}") from error


def _tips(setting: Any) -> Iterator[Indenter]:
    """Yield the tips in a part's settings at any depth, itself included."""
    if isinstance(setting, Indenter):
        yield setting
    if isinstance(setting, Settings):
        for name in type(setting).model_fields:
            yield from _tips(getattr(setting, name))
