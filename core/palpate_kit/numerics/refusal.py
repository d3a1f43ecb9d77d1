"""Refusal of a fit that cannot be done."""

from __future__ import annotations

from palpate import Flag


class NotFitted(Exception):  # noqa: N818 - it is an outcome, not a mistake
    """The samples do not allow the fit; becomes a flag of the track, never a number."""

    def __init__(self, code: str, text: str) -> None:
        super().__init__(text)
        self.flag = Flag(code, text)
