"""Messages of the page: a closed list, validated before anything is done."""

from __future__ import annotations

from typing import Annotated, Literal

from palpate import ConfigurationError
from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError

MAX_MESSAGE_SIZE = 64 * 1024  # [bytes], a choice: 32 answers with their keys, of 1000 characters each, fit

Name = Annotated[str, Field(min_length=1, max_length=1000)]
Text = Annotated[str, Field(max_length=1000)]


class Question(BaseModel):
    """Message of the page."""

    model_config = ConfigDict(extra="forbid", strict=True)


class CurveQuestion(Question):
    """Question for a curve to draw."""

    do: Literal["curve"]
    curve: Name
    number: int = 0


class FilterQuestion(Question):
    """Question for the curves that filter words hold."""

    do: Literal["filter"]
    words: Text


class MarkOrder(Question):
    """Order to mark a curve."""

    do: Literal["mark"]
    curve: Name
    mark: Literal["good", "bad", "none"]
    reason: Text = ""


class SetOrder(Question):
    """Order to change a setting of the curves of filter words, or of all."""

    do: Literal["set"]
    assignment: Text
    where: Text | None = None


class TipOrder(Question):
    """Order to replace the tip or the model of all curves."""

    do: Literal["tip", "model"]
    value: Name


class RefitOrder(Question):
    """Order to fit one curve, or all that are not current, to cancel that, or to undo the latest change."""

    do: Literal["refit", "refit-all", "cancel", "undo"]
    curve: Text = ""


class FactsQuestion(Question):
    """Question for the open facts of the rig, and for those that ``curves.csv`` states of a curve."""

    do: Literal["facts"]
    curve: Text = ""


class FactsOrder(Question):
    """Order to state facts of the rig, by their keys in ``rig.toml``."""

    do: Literal["state"]
    answers: Annotated[dict[Name, Name], Field(min_length=1, max_length=32)]


class GroupsQuestion(Question):
    """Question for statistics of groups and tests between them."""

    do: Literal["groups"]
    by: Name
    parameter: Name


class CompareQuestion(Question):
    """Question for a comparison of the model of the folder with another one on a curve."""

    do: Literal["compare"]
    curve: Name
    model: Name


class ExportOrder(Question):
    """Order to write a report, a picture, a map or the history into the folder."""

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
READ_ONLY_MESSAGES = (
    CurveQuestion,
    FilterQuestion,
    FactsQuestion,
    GroupsQuestion,
    CompareQuestion,
)  # they write nothing


def read_message(text: str | bytes) -> Question:
    """Return a message of the page; raises ConfigurationError for anything else."""
    try:
        return _MESSAGES.validate_json(text)
    except ValidationError as error:
        first = error.errors()[0]
        raise ConfigurationError(f"the page: {'.'.join(map(str, first['loc']))}: {first['msg']}") from error
