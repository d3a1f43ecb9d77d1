"""The documentation site: sphinx-build -W --keep-going docs site."""

import importlib.metadata
import re
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))
from formulas import with_math
from make_reference import write_reference
from sphinx.application import Sphinx

project, author = "palpate", "The palpate project"
version = release = importlib.metadata.version("palpate")
extensions = ["myst_nb", "sphinx.ext.autodoc", "mathml"]
html_math_renderer = "mathml"
html_theme = "furo"
html_static_path = ["_static"]
html_css_files = ["code-blocks.css"]
html_title = f"palpate {version}"
html_show_copyright = False
exclude_patterns = ["_build"]
myst_enable_extensions = ["colon_fence", "dollarmath"]
myst_heading_anchors = 3
nb_execution_mode = "force"
nb_execution_raise_on_error = True
nb_execution_timeout = 600  # of a cell, where other work goes on
nb_merge_streams = True
autodoc_typehints = "none"
autodoc_member_order = "bysource"
# Links to files of the repository, which are not pages of the site; pages of decisions, which their own index lists;
# cells of pages that are not executed.
suppress_warnings = ["myst.xref_missing", "myst.header", "toc.not_included", "myst-nb.lexer"]

write_reference(Path(__file__).parent / "reference")


def _formulas_of_tables(app: Sphinx, page: str, source: list[str]) -> None:
    """Tables of tips and models have their formulas as text, as `palpate describe` prints them."""
    if page == "models":
        source[0] = "\n".join(_cells(line) if line.startswith("| `") else line for line in source[0].split("\n"))


def _cells(row: str) -> str:
    made = [(cell, re.sub(r"\\([\[\]|])", r"\1", with_math(cell))) for cell in row.split(" | ")]
    return " | ".join(shown if "$" in shown else cell for cell, shown in made)


def setup(app: Sphinx) -> None:
    """Called by Sphinx."""
    app.connect("source-read", _formulas_of_tables)
