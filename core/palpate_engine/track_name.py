"""The name of a track: model and estimator, as one text where one text is needed."""

from __future__ import annotations


class TrackName(str):
    """``MODEL/ESTIMATOR``: key of results, column of tables, topic of logs, with its two halves."""

    __slots__ = ("estimator", "model")
    model: str  # name of the [model.*] table
    estimator: str  # name of the [estimator.*] table

    def __new__(cls, model: str, estimator: str) -> TrackName:
        """Return the name of a model with an estimator."""
        name = super().__new__(cls, f"{model}/{estimator}")
        name.model, name.estimator = model, estimator
        return name

    def __getnewargs__(self) -> tuple[str, str]:  # type: ignore[override] # str.__new__ takes one
        return self.model, self.estimator

    @classmethod
    def parse(cls, text: str) -> TrackName:
        """Return the name that a text spells; raises ValueError where it is not of the form MODEL/ESTIMATOR."""
        if isinstance(text, TrackName):
            return text
        model, slash, estimator = text.partition("/")
        if not (model and slash and estimator):
            raise ValueError(f"{text!r} is not a track: write MODEL/ESTIMATOR")
        return cls(model, estimator)
