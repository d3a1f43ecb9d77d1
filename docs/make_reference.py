"""Reference pages of what is installed: parts by kind, commands, tables, results, the Python face. Run by conf.py."""

import inspect
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import typer
from formulas import with_math
from make_flags import page as flags_page
from make_thresholds import page as thresholds_page
from palpate import Settings
from palpate_commands.describe import default_text, type_text
from palpate_engine import AlignmentSettings, Registry, RunSettings, SafetySettings, function_of, registry
from palpate_kit.runs.result_model import result_schema

_KINDS = {
    "indenter": "Tips",
    "model": "Contact models",
    "estimator": "Filters and fits",
    "device": "Devices and logs",
    "trajectory": "Motions",
    "surface": "Surfaces",
    "sink": "Sinks",
    "twin": "Twins",
}
_FACE = ("load", "run", "record", "read", "fit", "compare", "sweep", "open_run")
_CLASSES = ("Draft", "FinishedRun", "TrackView", "UncertainQuantity", "Record", "Fit", "Sweep", "MapView", "Picture")


def write_reference(folder: Path) -> None:
    """Write every page that has changed."""
    folder.mkdir(exist_ok=True)
    known = registry.load()
    pages = {f"{kind}s": "\n".join(_of_kind(kind, title, known)) for kind, title in _KINDS.items()}
    makers = {"tables": _tables(known), "options": _commands(), "python": _python(), "result": _result()}
    pages |= {"flags": flags_page(known), "thresholds": thresholds_page()}
    pages |= {name: "\n".join(lines) for name, lines in makers.items()}
    for name, text in pages.items():
        path = folder / f"{name}.md"
        if not path.is_file() or path.read_text(encoding="utf-8") != text + "\n":
            path.write_text(text + "\n", encoding="utf-8")


def _of_kind(kind: str, title: str, known: Registry) -> Iterator[str]:
    yield f"# {title}\n\nTypes of `[{kind}.*]`; `palpate describe NAME` prints the same.\n"
    for name, entry in known.parts[kind].items():
        yield f"## {name}\n\n{_document(entry.part)}\n"
        parameters = getattr(entry.part, "parameters", ())
        if isinstance(parameters, tuple) and parameters:
            yield from ("| parameter | symbol | unit | |", "|---|---|---|---|")
            yield from (f"| `{p.name}` | {p.symbol} | {p.unit} | {_cell(p.meaning)} |" for p in parameters)
            yield ""
        yield from _keys(entry.part)


def _tables(known: Registry) -> Iterator[str]:
    yield '# Tables of a pipeline file\n\nBesides `[KIND.NAME]` for parts. At the top may stand `palpate = "0.2"`.\n'
    tables = {"run": RunSettings, "alignment": AlignmentSettings, "safety": SafetySettings, **known.tables}
    for name, settings in tables.items():
        yield f"## [{name}]\n\n{_document(settings)}\n"
        yield from _keys(settings)


def _result() -> Iterator[str]:
    schema = result_schema()
    yield "# Keys of result.json\n\nBy `palpate describe schema result`, which is for programs.\n"
    for name, table in (("result.json", schema), *schema["$defs"].items()):
        yield f"## {name}\n\n{_cell(table.get('description', ''))}\n"
        yield from ("| key | | meaning |", "|---|---|---|")
        for key, value in table.get("properties", {}).items():
            yield f"| `{key}` | {_cell(_json_type(value))} | {_cell(value.get('description', ''))} |"
        yield ""


def _json_type(value: dict[str, Any]) -> str:
    if "anyOf" in value:
        return " or ".join(map(_json_type, value["anyOf"]))
    inner = value.get("items") or value.get("additionalProperties")
    return value.get("$ref", value.get("type", "any")).split("/")[-1] + (
        f" of {_json_type(inner)}" if isinstance(inner, dict) and inner else ""
    )


def _document(part: type) -> str:
    """A docstring with its formulas as LaTeX; what it assumes, and its source, are paragraphs of their own."""
    return with_math(re.sub(r"\n(?=Source: |Assumes )", "\n\n", inspect.getdoc(part) or ""))


def _keys(settings: type[Settings]) -> Iterator[str]:
    if not settings.model_fields:
        return
    yield from ("| key | | default | meaning |", "|---|---|---|---|")
    for key, field in settings.model_fields.items():
        default = "must be given" if field.is_required() else default_text(field.get_default(), field.metadata)
        kind = type_text(field.annotation, field.metadata)
        cells = (kind, default.removeprefix("default "), field.description or "")
        yield f"| `{key}` | {' | '.join(map(_cell, cells))} |"
    yield ""


def _cell(text: str) -> str:
    for sign in "\\|*_<>[]$`":
        text = text.replace(sign, f"\\{sign}")
    return " ".join(text.split())


def _commands() -> Iterator[str]:
    yield "# Options of the commands\n"
    for name, command in registry.load_commands().commands.items():
        function = function_of(command)
        app = typer.Typer(add_completion=False)
        app.command(name=name)(function)
        called = typer.main.get_command(app)
        yield f"## palpate {name}\n\n{_cell(inspect.getdoc(function) or '')}\n"
        yield from ("| argument or option | meaning |", "|---|---|")
        for parameter in called.params:
            meaning = _cell(getattr(parameter, "help", None) or "")
            option = parameter.param_type_name == "option"
            shown = ", ".join(parameter.opts) if option else (parameter.metavar or (parameter.name or "").upper())
            yield f"| `{shown}` | {meaning} |"
        yield ""


def _python() -> Iterator[str]:
    yield "# Python\n\n```{eval-rst}"
    yield from (f".. autofunction:: palpate_notebook.{name}\n" for name in _FACE)
    options = "   :members:\n   :inherited-members: float\n   :class-doc-from: class\n"
    yield from (f".. autoclass:: palpate_notebook.{name}\n{options}" for name in _CLASSES)
    yield "```"
