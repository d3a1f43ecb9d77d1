"""Tables of numbers as text, many numbers at a time."""

from __future__ import annotations

from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from palpate import Floats

Words = NDArray[np.uint64]  # of eight characters each, the first in the lowest byte; those that are zero are left out

_DIGITS = 10
_HALF = 5  # digits that are looked up at once
_MOST = 290  # decimal exponents; beyond them powers of ten come near the ends of the floats
_UNSURE = 1e-4  # of the last digit; so near to a half the product with a power of ten, good to 3e-6, may be beyond it
_FEW = 400  # numbers; for so few, as a live run has, Python is faster
_ROWS = 512  # at once: what is worked on stays in the processor's cache
_BYTE, _WORD = np.uint64(8), np.uint64(64 - 8)


def csv_rows(table: Floats) -> str:
    """Rows (n, m) with every number as ``%.10g`` writes it, and nothing for NaN, between commas."""
    if table.size < _FEW:
        row = ",".join([f"%.{_DIGITS}g"] * table.shape[1]) + "\n"
        return ((row * len(table)) % tuple(table.ravel().tolist())).replace("nan", "")
    return "".join(_some_rows(table[begin : begin + _ROWS]) for begin in range(0, len(table), _ROWS))


def _some_rows(table: Floats) -> str:
    numbers, cells = table.ravel(), np.empty((*table.shape, 3), np.uint64)
    missing = np.isnan(numbers)
    for word, part in enumerate(_written(np.where(missing, 0.0, numbers))):
        part[missing] = 0
        cells[..., word] = part.reshape(table.shape)
    cells[..., 0] |= ord(",")
    cells[:, 0, 0] ^= ord(",") ^ ord("\n")
    text = cells.astype("<u8", copy=False).tobytes().translate(None, b"\0")
    return text[1:].decode("ascii") + "\n"


def _written(numbers: Floats) -> tuple[Words, Words, Words]:
    """Return each number in three words: what stands before its digits after one free character, its digits, and the
    rest."""
    known, size = _known(), np.abs(numbers)
    beyond = (size > 10.0**_MOST) | ((size < 10.0**-_MOST) & (size > 0))
    size[beyond] = 1.0
    exponent = known.least.take(size.view(np.int64) >> 52)
    exponent += size >= known.next.take(exponent)
    scaled = size * known.scale.take(exponent)
    whole = np.rint(scaled)
    by_hand = beyond | (np.abs(np.abs(scaled - whole) - 0.5) < _UNSURE)
    over = whole >= 10.0**_DIGITS
    whole[over] /= 10
    exponent[over] += 1
    exponent[size == 0] = _place(0)
    digits = whole.astype(np.int64)
    high = digits // 10**_HALF
    low = digits - high * 10**_HALF
    kept = np.where(low == 0, known.kept.take(high), _HALF + known.kept.take(low))
    form = known.form.take(exponent) + kept
    first, second = _joined(known.digits.take(high), known.digits.take(low), form)
    second |= known.suffix.take(exponent)
    before = known.prefix.take(exponent) | (np.signbit(numbers).astype(np.uint64) * np.uint64(ord("-")) << _BYTE)
    for i in np.flatnonzero(by_hand):
        text = _word(f"{abs(numbers[i]):.{_DIGITS}g}")
        before[i] &= np.uint64(0xFFFF)
        first[i], second[i] = _halves(text)
    return before, first, second


def _joined(high: Words, low: Words, form: NDArray[np.int64]) -> tuple[Words, Words]:
    """Ten digits as text, in two words, with the point of their form and without what it leaves out."""
    first, second = high | (low << np.uint64(8 * _HALF)), low >> np.uint64(64 - 8 * _HALF)
    stays, moves, points = _forms()
    moved = (second << _BYTE) | (first >> _WORD)
    return (
        (first & stays[0].take(form)) | ((first << _BYTE) & moves[0].take(form)) | points[0].take(form),
        (second & stays[1].take(form)) | (moved & moves[1].take(form)) | points[1].take(form),
    )


class _DigitTables(NamedTuple):
    """What is looked up: by number of five digits, by binary exponent, by decimal exponent."""

    digits: Words
    kept: NDArray[np.uint8]  # digits but for zeros at the end
    least: NDArray[np.int64]  # place of the least decimal exponent
    next: Floats  # 10^(e + 1)
    scale: Floats  # 10^(9 - e)
    form: NDArray[np.int64]
    prefix: Words  # after two characters
    suffix: Words  # after the three characters that digits and point need of the last word


@cache
def _known() -> _DigitTables:
    numbers, still = np.arange(10**_HALF), np.ones(10**_HALF, bool)
    digits, kept = np.zeros(len(numbers), np.uint64), np.full(len(numbers), _HALF, np.uint8)
    for k in range(_HALF):
        digit = numbers // 10**k % 10
        digits |= (digit + ord("0")).astype(np.uint64) << np.uint64(8 * (_HALF - 1 - k))
        still &= digit == 0
        kept -= still
    exponents = range(-_MOST - 1, _MOST + 2)
    least = np.floor((np.arange(2048) - 1023) * np.log10(2.0)).astype(np.int64)
    small = [e for e in exponents if -4 <= e < 0]
    return _DigitTables(
        digits,
        kept,
        _place(np.clip(least, -_MOST - 1, _MOST)),
        np.array([float(f"1e{e + 1}") for e in exponents]),
        np.array([float(f"1e{_DIGITS - 1 - e}") for e in exponents]),
        np.array([(_DIGITS + 1) * (e + 1 if 0 <= e < _DIGITS else 0 if e in small else 1) for e in exponents]),
        np.array([_word("\0\0" + f"0.{'0' * (-e - 1)}" if e in small else "") for e in exponents], np.uint64),
        np.array([_word("" if -4 <= e < _DIGITS else f"\0\0\0e{e:+03d}") for e in exponents], np.uint64),
    )


@cache
def _forms() -> tuple[Words, Words, Words]:
    """Bits (2, forms) of ten digits that stay where they are, that move on by one character, and of the point.

    A form is 11 times the digits before the point, 0 where all are behind a point that is written already, and
    the digits that are kept.
    """
    bits = []
    for before in range(_DIGITS + 1):
        stay = (1 << 8 * before) - 1
        for kept in range(_DIGITS + 1):
            if before == 0 or kept <= before:
                bits.append([(1 << 8 * max(kept, before)) - 1, 0, 0])
            else:
                bits.append([stay, ((1 << 8 * (kept + 1)) - 1) & ~(stay << 8 | 0xFF), ord(".") << 8 * before])
    stays, moves, points = np.array([[_halves(part) for part in form] for form in bits], np.uint64).transpose(1, 2, 0)
    return stays.copy(), moves.copy(), points.copy()


def _place(exponent: NDArray[np.int64] | int) -> Any:
    """Where a decimal exponent stands in what is looked up."""
    return exponent + _MOST + 1


def _word(text: str) -> int:
    return int.from_bytes(text.encode("ascii"), "little")


def _halves(both: int) -> tuple[int, int]:
    return both & (2**64 - 1), both >> 64
