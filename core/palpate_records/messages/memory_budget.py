"""The budget of a message: how much memory its contents may take, by the bytes that are there."""

from __future__ import annotations

from palpate import LogError

FREE = 1 << 25  # [bytes] that a message of any size may take
ELEMENT = 256  # [bytes] of an element that is walked in Python: its path and its place
VALUE = 64  # [bytes] of a value that a parser in C makes


class BudgetError(LogError):
    """Contents that would take more memory than their bytes allow."""


class Budget:
    """Memory that contents may take [bytes]: 32 MiB, and in addition `per_byte` for every byte of them.

    A reader charges what it is about to make, arrays as a whole, before it makes anything. Raises BudgetError.
    """

    def __init__(self, what: str, size: int = 0, per_byte: int = 1) -> None:
        self._what, self._per_byte = what, per_byte
        self._size = self.spent = 0
        self._allowance = FREE
        self.grow(size)

    def grow(self, size: int) -> None:
        """Take in more bytes of the same contents."""
        self._size += size
        self._allowance += self._per_byte * size

    def charge(self, cost: int) -> None:
        """Spend memory [bytes]."""
        self.spent += cost
        if self.spent > self._allowance:
            raise BudgetError(
                f"{self._what} is damaged: it has {self._size} bytes, and its elements would take more than "
                f"{self._allowance >> 20} MiB of memory"
            )
