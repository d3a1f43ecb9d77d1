"""Versions of palpate in which its parts have had their names since; those of 0.2 are not listed."""

from __future__ import annotations

from collections.abc import Mapping

# By kind and name, such as ("indenter", "ring"): "0.3". An older pipeline, written where a third party offered a part
# of that name, means the third party's.
FIRST_VERSIONS: Mapping[tuple[str, str], str] = {}

# In these kinds another part of one name gives another number, with the sentence in every run; in the others it may
# move an arm or read another sensor, so the pipeline has to say which part it means.
KINDS_WITH_OLDER_NAMES = frozenset({"indenter", "model", "estimator"})
