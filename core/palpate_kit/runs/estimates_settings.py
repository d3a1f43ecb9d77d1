"""``[estimates]``: how the tables of estimates are written."""

from __future__ import annotations

from importlib.util import find_spec
from typing import Literal, Self

from palpate import Settings
from pydantic import Field, model_validator


class EstimatesSettings(Settings):
    """The file format of a run's tables of estimates."""

    format: Literal["csv", "parquet"] = Field(
        default="csv",
        description='"csv": text with ten digits; "parquet": columns of binary numbers, for pandas, polars or DuckDB',
    )

    @model_validator(mode="after")
    def _can_be_written(self) -> Self:
        if self.format == "parquet" and find_spec("pyarrow") is None:
            raise ValueError('format = "parquet" needs pyarrow; pip install "palpate[parquet]"')
        return self
