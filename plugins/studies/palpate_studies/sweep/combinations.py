"""What a [sweep] table asks for."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

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
        """Return the combination of a number, whose run goes into a folder of the sweep's."""
        return cls(number, values, Job(f"combination {number}", plan, folder / f"{number:05d}"))


def refuse_hopeless(planned: Sequence[Combination]) -> None:
    """Raise what is wrong with the first combination if the last one is wrong, too: then it is not a value's fault."""
    try:
        planned[0].job.pipeline()
    except UserError as error:
        try:
            planned[-1].job.pipeline()
        except UserError:
            raise error from None


def combinations_of(source: Source) -> list[dict[str, Any]]:
    """Return the combinations that a [sweep] table asks for, each a value for every swept setting.

    Raises ConfigurationError where the table is missing, empty, or not made of lists.
    """
    table = source.tables.get("sweep")
    if not isinstance(table, dict):
        raise ConfigurationError(
            f'{source.path}: the table [sweep] is missing: give lists of values, such as "estimator.ekf.force_std" = '
            '["0.03 N", "0.05 N"]'
        )
    lists = dict(_lists(source, {key: value for key, value in table.items() if key != "combine"}, ()))
    if not lists:
        raise ConfigurationError(f"{source.where(('sweep',))}: [sweep] names no setting")
    combine = table.get("combine", "grid")
    if combine == "list":
        lengths = {key: len(values) for key, values in lists.items()}
        if len(set(lengths.values())) > 1:
            told = ", ".join(f"{key} has {length}" for key, length in lengths.items())
            raise ConfigurationError(
                f'{source.where(("sweep",))}: [sweep] combine = "list" needs lists of one length: {told}'
            )
        tuples: Iterable[tuple[Any, ...]] = zip(*lists.values(), strict=True)
    elif combine == "grid":
        tuples = itertools.product(*lists.values())
    else:
        raise ConfigurationError(
            f'{source.where(("sweep", "combine"))}: [sweep] combine: {combine!r} is not one of "grid", "list"'
        )
    return [dict(zip(lists, values, strict=True)) for values in tuples]


def _lists(source: Source, table: dict[str, Any], path: tuple[str, ...]) -> Iterator[tuple[str, list[Any]]]:
    """Lists by dotted setting; a key may be dotted in quotes, or without them, which makes tables in tables."""
    for key, value in table.items():
        where = (*path, key)
        if isinstance(value, dict):
            yield from _lists(source, value, where)
            continue
        name = ".".join(where)
        if not isinstance(value, list) or not value:
            raise ConfigurationError(
                f"{source.where(('sweep', *where))}: [sweep] {name}: {value!r}: must be a list of values"
            )
        if "." not in name:
            raise ConfigurationError(
                f"{source.where(('sweep', *where))}: [sweep] {name}: must be a setting with its table, "
                'such as "estimator.ekf.force_std"'
            )
        yield name, value
