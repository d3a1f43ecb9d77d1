"""What the page can ask for: a closed list of messages, read before anything is done."""

from __future__ import annotations

from typing import Annotated, Literal

from palpate import ConfigurationError
from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError

LARGEST = 64 * 1024  # bytes of a message

Name = Annotated[str, Field(min_length=1, max_length=1000)]
Text = Annotated[str, Field(max_length=1000)]


class Question(BaseModel):
    """A message of the page."""

    model_config = ConfigDict(extra="forbid", strict=True)


class CurveQuestion(Question):
    """A curve to look at."""

    do: Literal["curve"]
    curve: Name
    number: int = 0


class FilterQuestion(Question):
    """Filter words: which rows hold."""

    do: Literal["filter"]
    words: Text


class MarkOrder(Question):
    """A mark on a curve."""

    do: Literal["mark"]
    curve: Name
    mark: Literal["good", "bad", "none"]
    reason: Text = ""


class SetOrder(Question):
    """A setting of one curve, of those of filter words, or of all."""

    do: Literal["set"]
    assignment: Text
    where: Text | None = None


class TipOrder(Question):
    """Another tip, or another model, for all curves."""

    do: Literal["tip", "model"]
    value: Name


class RefitOrder(Question):
    """One curve fitted again, or all that are not current; or an end to that."""

    do: Literal["refit", "refit-all", "cancel", "undo"]
    curve: Text = ""


class FactsQuestion(Question):
    """Which facts of the rig are open, and which ``curves.csv`` states of a curve."""

    do: Literal["facts"]
    curve: Text = ""


class FactsOrder(Question):
    """Facts of the rig, by their keys in ``rig.toml``."""

    do: Literal["state"]
    answers: Annotated[dict[Name, Name], Field(min_length=1, max_length=32)]


class GroupsQuestion(Question):
    """Statistics and tests between groups."""

    do: Literal["groups"]
    by: Name
    parameter: Name


class CompareQuestion(Question):
    """Models weighed on a curve."""

    do: Literal["compare"]
    curve: Name
    model: Name


class ExportOrder(Question):
    """Something to write into the folder."""

    do: Literal["export"]
    what: Literal["report", "groups", "map", "figure", "history"]
    by: Text = ""
    parameter: Text = ""
    curve: Text = ""


Message = Annotated[
    CurveQuestion | FilterQuestion | MarkOrder | SetOrder | TipOrder | RefitOrder | FactsQuestion | FactsOrder
    | GroupsQuestion | CompareQuestion | ExportOrder,
    Field(discriminator="do"),
]  # fmt: skip
_MESSAGES: TypeAdapter[
    CurveQuestion | FilterQuestion | MarkOrder | SetOrder | TipOrder | RefitOrder | FactsQuestion | FactsOrder
    | GroupsQuestion | CompareQuestion | ExportOrder
] = TypeAdapter(Message)  # fmt: skip
READING = (CurveQuestion, FilterQuestion, FactsQuestion, GroupsQuestion, CompareQuestion)  # which write nothing


def read_message(text: str | bytes) -> Question:
    """Return a message of the page; raises ConfigurationError for anything else."""
    try:
        return _MESSAGES.validate_json(text)
    except ValidationError as error:
        first = error.errors()[0]
        raise ConfigurationError(f"the page: {'.'.join(map(str, first['loc']))}: {first['msg']}") from error
