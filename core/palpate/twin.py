"""Twins: devices in software that speak the wire protocol of the real ones."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from typing import ClassVar

from palpate.parts import Part


class Twin(Part, ABC):
    """Settings of a twin; it stands in the pipeline file of the rig that it replaces, which does not look at it."""

    kind: ClassVar[str] = "twin"

    @abstractmethod
    def serve(self, seed: int, ready: Callable[[Mapping[str, str]], None]) -> None:
        """Serve in this process until SIGTERM, Ctrl-C or the end of the standard input.

        `ready` is called once the twin can be reached, with what a user should know: addresses, by name. Raises
        DeviceError where an address cannot be had.
        """
