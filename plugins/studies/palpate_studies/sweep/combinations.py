"""The combinations of settings that a [sweep] table lists."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import tomli_w
from palpate import ConfigurationError, UserError
from palpate_engine import Source
from palpate_kit.jobs.job import Job, PortablePipeline


@dataclass(frozen=True)
class Combination:
    """One value for every swept setting, and the job that is a run of it."""

    number: int
    values: Mapping[str, Any]
    job: Job

    @classmethod
    def of(cls, number: int, values: Mapping[str, Any], plan: PortablePipeline, folder: Path) -> Combination:
        """Return the combination of a number from 1, whose run has a folder of its own in that of the sweep."""
        return cls(number, values, Job(f"combination {number}", plan, folder / f"{number:05d}"))


def refuse_hopeless(planned: Sequence[Combination]) -> None:
    """Raise the error of the first combination if the last one has an error, too: then all are likely to fail."""
    try:
        planned[0].job.pipeline()
    except UserError as error:
        try:
            planned[-1].job.pipeline()
        except UserError:
            raise error from None


def combinations_of(source: Source) -> list[dict[str, Any]]:
    """Return the combinations of a [sweep] table, each a value for every swept setting by its dotted name.

    Raises ConfigurationError for a table that is missing, empty, or not made of lists.
    """
    table = source.tables.get("sweep")
    if not isinstance(table, dict):
        raise ConfigurationError(
            f'{source.path}: the table [sweep] is missing: give lists of values, such as "estimator.ekf.force_std" = '
            '["0.03 N", "0.05 N"]'
        )
    # Every key but `combine` is a setting with its list of values.
    lists = dict(_setting_lists(source, {key: value for key, value in table.items() if key != "combine"}, ()))
    if not lists:
        raise ConfigurationError(f"{source.where(('sweep',))}: [sweep] names no setting")
    combine = table.get("combine", "grid")
    if combine == "list":
        lengths = {key: len(values) for key, values in lists.items()}
        if len(set(lengths.values())) > 1:
            lengths_text = ", ".join(f"{key} has {length}" for key, length in lengths.items())
            raise ConfigurationError(
                f'{source.where(("sweep",))}: [sweep] combine = "list" needs lists of one length: {lengths_text}'
            )
        value_tuples: Iterable[tuple[Any, ...]] = zip(*lists.values(), strict=True)
    elif combine == "grid":
        value_tuples = itertools.product(*lists.values())
    else:
        raise ConfigurationError(
            f'{source.where(("sweep", "combine"))}: [sweep] combine: {combine!r} is not one of "grid", "list"'
        )
    return [dict(zip(lists, values, strict=True)) for values in value_tuples]


def assignments_of(values: Mapping[str, Any]) -> list[str]:
    """Return the values of settings as assignments "KEY=VALUE" in TOML."""
    return [f"{key}={tomli_w.dumps({'v': value}).strip().removeprefix('v = ')}" for key, value in values.items()]


def _setting_lists(source: Source, table: dict[str, Any], path: tuple[str, ...]) -> Iterator[tuple[str, list[Any]]]:
    """Yield dotted setting and list of values of each key of a table, whose own keys from [sweep] on are a path.

    A key may be dotted in quotes, or without them, which makes tables in tables. Raises ConfigurationError for a value
    that is not a list, and for a setting without its table.
    """
    for key, value in table.items():
        key_path = (*path, key)
        if isinstance(value, dict):
            yield from _setting_lists(source, value, key_path)
            continue
        name = ".".join(key_path)
        if not isinstance(value, list) or not value:
            raise ConfigurationError(
                f"{source.where(('sweep', *key_path))}: [sweep] {name}: {value!r}: must be a list of values"
            )
        if "." not in name:
            raise ConfigurationError(
                f"{source.where(('sweep', *key_path))}: [sweep] {name}: must be a setting with its table, "
                'such as "estimator.ekf.force_std"'
            )
        yield name, value
