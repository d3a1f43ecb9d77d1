"""The page on tips and models keeps up with them."""

from __future__ import annotations

import runpy
from pathlib import Path

import pytest
from palpate_models import palpate_indenters, palpate_models

DOCS = Path(__file__).parents[2] / "docs"
TEXT = (DOCS / "models.md").read_text(encoding="utf-8")


@pytest.mark.parametrize("name", [*palpate_indenters(), *palpate_models()])
def test_every_tip_and_model_is_on_the_page_and_in_a_picture(name):
    assert f"| `{name}` |" in TEXT
    pictures = "".join(path.read_text(encoding="utf-8") for path in (DOCS / "pictures").glob("*.svg"))
    assert f"<!-- {name} -->" in pictures


@pytest.mark.slow
def test_the_pictures_of_the_page_are_there_and_can_be_drawn():
    for name in ("tips", "models", "thickness"):
        assert f"](pictures/{name}.svg)" in TEXT
        assert (DOCS / "pictures" / f"{name}.svg").is_file()
    script = runpy.run_path(str(DOCS / "pictures.py"))
    assert set(script["tips"]()) == set(palpate_indenters())
    assert set(script["models"](script["tips"]()["sphere"])) == set(palpate_models())
