"""The names of `palpate_engine` as they were imported before: `from palpate.host import ...` works for this release."""

import warnings

from palpate_engine import *  # noqa: F403

from palpate import suggest as suggest

warnings.warn("import from palpate_engine instead of palpate.host, which goes", DeprecationWarning, stacklevel=2)
