"""A tip or a model is entered once in each place that lists them, and the page on them keeps up."""

from __future__ import annotations

import importlib
import runpy
from pathlib import Path

import palpate_models as family
import pytest
from palpate import ContactModel, Indenter, plugin

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
PACKAGE = Path(family.__file__).parent
OFFERED = {**family.palpate_indenters(), **family.palpate_models()}
FUNNEL = {"funnel": "palpate_models.indenters.funnel:Funnel"}


def read(*parts):
    return ROOT.joinpath(*parts).read_text(encoding="utf-8")


def missing_entries(name, target):
    """Return the places in which a tip or a model that a hook offers is still to be entered."""
    part = target.partition(":")[2]
    pictures = "".join(path.read_text(encoding="utf-8") for path in (DOCS / "pictures").glob("*.svg"))
    places = {
        f"plugins/models/palpate_models/__init__.py: {part} below TYPE_CHECKING": f"{part} as {part}"
        in (PACKAGE / "__init__.py").read_text(encoding="utf-8"),
        f"docs/models.md: a row for `{name}`": f"| `{name}` |" in read("docs", "models.md"),
        "docs/pictures: run python docs/pictures.py": f"<!-- {name} -->" in pictures,
    }
    if name in family.palpate_indenters():
        example = f"[indenter.{name}]"
        places[f"pipelines/parts/tips.toml: {example}"] = example in read("pipelines", "parts", "tips.toml")
    return [place for place, is_entered in places.items() if not is_entered]


@pytest.mark.parametrize("name", OFFERED)
def test_every_tip_and_model_is_entered_wherever_they_are_listed(name):
    assert missing_entries(name, OFFERED[name]) == []


def test_a_new_tip_is_missed_in_each_place(monkeypatch):
    tips = family.palpate_indenters()
    monkeypatch.setattr(family, "palpate_indenters", lambda: {**tips, **FUNNEL})
    assert missing_entries("funnel", FUNNEL["funnel"]) == [
        "plugins/models/palpate_models/__init__.py: Funnel below TYPE_CHECKING",
        "docs/models.md: a row for `funnel`",
        "docs/pictures: run python docs/pictures.py",
        "pipelines/parts/tips.toml: [indenter.funnel]",
    ]


def shipped_classes(kind):
    """Yield ``module:Class`` of every final class of a kind in the family."""
    for path in PACKAGE.rglob("*.py"):
        module = ".".join(("palpate_models", *path.relative_to(PACKAGE).with_suffix("").parts)).removesuffix(
            ".__init__"
        )
        for name, item in vars(importlib.import_module(module)).items():
            is_part = isinstance(item, type) and issubclass(item, kind) and item.__module__ == module
            if is_part and not item.__abstractmethods__ and not name.startswith("_"):
                yield f"{module}:{name}"


@pytest.mark.parametrize(("kind", "hook"), [(Indenter, "palpate_indenters"), (ContactModel, "palpate_models")])
def test_every_class_is_offered_by_its_hook(kind, hook):
    assert sorted(shipped_classes(kind)) == sorted(getattr(family, hook)().values())


@pytest.mark.slow
def test_the_pictures_of_the_page_are_there_and_can_be_drawn():
    for name in ("tips", "models", "thickness"):
        assert f"](pictures/{name}.svg)" in read("docs", "models.md")
        assert (DOCS / "pictures" / f"{name}.svg").is_file()
    script = runpy.run_path(str(DOCS / "pictures.py"))
    assert set(script["tips"]()) == set(family.palpate_indenters())
    assert set(script["models"](script["tips"]()["sphere"])) == set(family.palpate_models())


@pytest.mark.slow
def test_the_script_of_the_pictures_names_a_tip_without_an_example(monkeypatch):
    tips = family.palpate_indenters()
    monkeypatch.setattr(family, "palpate_indenters", plugin(lambda: {**tips, **FUNNEL}))
    with pytest.raises(SystemExit, match=r"tips\.toml has no \[indenter\.funnel\]"):
        runpy.run_path(str(DOCS / "pictures.py"))["tips"]()
