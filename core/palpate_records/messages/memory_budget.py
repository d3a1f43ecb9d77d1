"""The budget of a message: the memory that its contents may take, by their size."""

from __future__ import annotations

from palpate import LogError

FREE = 1 << 25  # [bytes] that a message of any size may take: a choice
ELEMENT = 256  # [bytes] of memory of an element that is walked in Python, its path and its place: a choice
VALUE = 64  # [bytes] of memory of a value that a parser in C makes: a choice


class BudgetError(LogError):
    """Contents that would take more memory than their bytes allow."""


class Budget:
    """Memory that contents may take [bytes]: 32 MiB, and in addition `per_byte` for every byte of them.

    A reader charges the memory of its results, arrays as a whole, before it makes them. Raises BudgetError.
    """

    def __init__(self, subject: str, size: int = 0, per_byte: int = 1) -> None:
        self._subject = subject  # of an error, such as "a message of topic /a"
        self._per_byte = per_byte
        self._size = 0
        self.spent = 0
        self._allowance = FREE
        self.grow(size)

    def grow(self, size: int) -> None:
        """Add bytes of the same contents."""
        self._size += size
        self._allowance += self._per_byte * size

    def charge(self, cost: int) -> None:
        """Spend memory [bytes]; raises BudgetError beyond the allowance."""
        self.spent += cost
        if self.spent > self._allowance:
            raise BudgetError(
                f"{self._subject} is damaged: it has {self._size} bytes, and its elements would take more than "
                f"{self._allowance >> 20} MiB of memory"
            )
