"""The documentation site: sphinx-build -W --keep-going docs site."""

import importlib.metadata
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))
from make_reference import write_reference

project, author = "palpate", "The palpate project"
version = release = importlib.metadata.version("palpate")
extensions = ["myst_nb", "sphinx.ext.autodoc", "mathml"]
html_math_renderer = "mathml"
html_theme = "furo"
html_title = f"palpate {version}"
exclude_patterns = ["_build"]
myst_enable_extensions = ["colon_fence", "dollarmath"]
myst_heading_anchors = 3
nb_execution_mode = "force"
nb_execution_raise_on_error = True
nb_execution_timeout = 120
nb_merge_streams = True
autodoc_typehints = "none"
autodoc_member_order = "bysource"
# Links to files of the repository, which are no pages of the site; pages of decisions, which their own index lists.
suppress_warnings = ["myst.xref_missing", "myst.header", "toc.not_included"]

write_reference(Path(__file__).parent / "reference")
