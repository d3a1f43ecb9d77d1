"""Tables of numbers as text, many numbers at a time.

A number is written with ten significant digits, as ``%.10g`` does. Its text is three words of eight characters, which
are looked up in tables and joined by shifts: the sign and zeros before the digits; the digits with their point, over
two words; and the exponent. Characters that stay zero are left out at the end.
"""

from __future__ import annotations

from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from palpate import Floats

Words = NDArray[np.uint64]  # of eight characters each, the first in the lowest byte; those that are zero are left out

_DIGITS = 10  # significant ones
_HALF_DIGITS = 5  # that are looked up at once: half of all
_MAX_EXPONENT = 290  # decimal; beyond it powers of ten come near the ends of the floats
_SMALLEST_FIXED = -4  # decimal exponent, below which ``%g`` writes an exponent
_TIE_MARGIN = 1e-4  # of the last digit, about a half: the product with a power of ten is good to 3e-6
_MIN_NUMBERS = 400  # for fewer, as a live run has, Python is faster (measured)
_ROWS_AT_ONCE = 512  # which stay in the processor's cache (choice)
_BYTE_BITS = 8
_WORD_BITS = 64
_MANTISSA_BITS = 52  # of a double, behind its binary exponent
_EXPONENT_BIAS = 1023  # of a double
_EXPONENT_CODES = 2048  # of a double
_BYTE, _ALL_BUT_A_BYTE = np.uint64(_BYTE_BITS), np.uint64(_WORD_BITS - _BYTE_BITS)
_TWO_CHARACTERS = np.uint64(0xFFFF)


def csv_rows(table: Floats) -> str:
    """Return rows (n, m) with every number as ``%.10g`` writes it, and nothing for NaN, between commas."""
    if table.size < _MIN_NUMBERS:
        row = ",".join([f"%.{_DIGITS}g"] * table.shape[1]) + "\n"
        return ((row * len(table)) % tuple(table.ravel().tolist())).replace("nan", "")
    begins = range(0, len(table), _ROWS_AT_ONCE)
    return "".join(_some_rows(table[begin : begin + _ROWS_AT_ONCE]) for begin in begins)


def _some_rows(table: Floats) -> str:
    """Return rows (n, m) as text; each number brings the comma, or the end of the line, before it."""
    numbers, cells = table.ravel(), np.empty((*table.shape, 3), np.uint64)
    is_missing = np.isnan(numbers)
    for word, words in enumerate(_number_words(np.where(is_missing, 0.0, numbers))):
        words[is_missing] = 0
        cells[..., word] = words.reshape(table.shape)
    cells[..., 0] |= ord(",")
    cells[:, 0, 0] ^= ord(",") ^ ord("\n")
    text = cells.astype("<u8", copy=False).tobytes().translate(None, b"\0")
    return text[1:].decode("ascii") + "\n"


def _number_words(numbers: Floats) -> tuple[Words, Words, Words]:
    """Return the words of each number: sign and zeros behind one free character, digits, and last digits with exponent.

    A word is eight characters as a whole number. The ten digits are rint(|x| 10^(9 - e)), and looked up by halves.
    Numbers beyond the tables, and those whose last digit is nearly a tie, are written by Python.
    """
    tables, size = _digit_tables(), np.abs(numbers)
    is_beyond = (size > 10.0**_MAX_EXPONENT) | ((size < 10.0**-_MAX_EXPONENT) & (size > 0))
    size[is_beyond] = 1.0
    # The decimal exponent: of the least number of this binary exponent, one more beyond the next power of ten. The bits
    # of a double above its mantissa are the binary exponent.
    exponent = tables.least.take(size.view(np.int64) >> _MANTISSA_BITS)
    exponent += size >= tables.next.take(exponent)
    # Ten digits as a whole number.
    scaled = size * tables.scale.take(exponent)
    whole = np.rint(scaled)
    by_python = is_beyond | (np.abs(np.abs(scaled - whole) - 0.5) < _TIE_MARGIN)
    is_over = whole >= 10.0**_DIGITS
    whole[is_over] /= 10
    exponent[is_over] += 1
    exponent[size == 0] = _exponent_index(0)
    digits = whole.astype(np.int64)
    high = digits // 10**_HALF_DIGITS
    low = digits - high * 10**_HALF_DIGITS
    # Without zeros at the end, in the form of the exponent.
    significant = np.where(low == 0, tables.significant.take(high), _HALF_DIGITS + tables.significant.take(low))
    form = tables.form.take(exponent) + significant
    first, second = _digit_words(tables.digits.take(high), tables.digits.take(low), form)
    second |= tables.suffix.take(exponent)
    minus = np.signbit(numbers).astype(np.uint64) * np.uint64(ord("-")) << _BYTE
    prefix = tables.prefix.take(exponent) | minus
    for i in np.flatnonzero(by_python):
        text = _text_bits(f"{abs(numbers[i]):.{_DIGITS}g}")
        prefix[i] &= _TWO_CHARACTERS  # the free character and the sign
        first[i], second[i] = _two_words(text)
    return prefix, first, second


def _digit_words(high: Words, low: Words, form: NDArray[np.int64]) -> tuple[Words, Words]:
    """Return ten digits as text in two words: with the point of their form, without digits that the form leaves out.

    `high` and `low` are the words of five digits each. A form says how many digits are before the point and kept.
    Digits before the point stay, those behind it move on by one character.
    """
    first = high | (low << np.uint64(_BYTE_BITS * _HALF_DIGITS))
    second = low >> np.uint64(_WORD_BITS - _BYTE_BITS * _HALF_DIGITS)
    stays, moves, points = _forms()
    moved_first = first << _BYTE
    moved_second = (second << _BYTE) | (first >> _ALL_BUT_A_BYTE)
    return (
        (first & stays[0].take(form)) | (moved_first & moves[0].take(form)) | points[0].take(form),
        (second & stays[1].take(form)) | (moved_second & moves[1].take(form)) | points[1].take(form),
    )


class _DigitTables(NamedTuple):
    """Tables by number of five digits, by binary exponent, and by decimal exponent e."""

    digits: Words  # (100 000,) five digits as text
    significant: NDArray[np.uint8]  # (100 000,) of five digits, those before zeros at the end
    least: NDArray[np.int64]  # (2048,) index of e of the least number with a binary exponent
    next: Floats  # 10^(e + 1)
    scale: Floats  # 10^(9 - e)
    form: NDArray[np.int64]  # see `_forms`
    prefix: Words  # zeros before the digits, after two characters
    suffix: Words  # exponent, after the three characters that digits and point need of the last word


@cache
def _digit_tables() -> _DigitTables:
    """Return the tables by which numbers become text, made once: by five digits, and by the decimal exponent e."""
    numbers = np.arange(10**_HALF_DIGITS)
    digits = np.zeros(len(numbers), np.uint64)
    significant = np.full(len(numbers), _HALF_DIGITS, np.uint8)
    only_zeros = np.ones(len(numbers), bool)
    for k in range(_HALF_DIGITS):  # from the last digit on
        digit = numbers // 10**k % 10
        digits |= (digit + ord("0")).astype(np.uint64) << np.uint64(_BYTE_BITS * (_HALF_DIGITS - 1 - k))
        only_zeros &= digit == 0
        significant -= only_zeros
    exponents = range(-_MAX_EXPONENT - 1, _MAX_EXPONENT + 2)
    least = np.floor((np.arange(_EXPONENT_CODES) - _EXPONENT_BIAS) * np.log10(2.0)).astype(np.int64)
    return _DigitTables(
        digits=digits,
        significant=significant,
        least=_exponent_index(np.clip(least, -_MAX_EXPONENT - 1, _MAX_EXPONENT)),
        next=np.array([float(f"1e{e + 1}") for e in exponents]),
        scale=np.array([float(f"1e{_DIGITS - 1 - e}") for e in exponents]),
        form=np.array([(_DIGITS + 1) * _digits_before_point(e) for e in exponents]),
        prefix=np.array([_text_bits(_zeros_before(e)) for e in exponents], np.uint64),
        suffix=np.array([_text_bits(_exponent_text(e)) for e in exponents], np.uint64),
    )


def _digits_before_point(exponent: int) -> int:
    """Return how many of ten digits are before the point: 0 where zeros and the point are written before them."""
    if 0 <= exponent < _DIGITS:
        return exponent + 1
    return 0 if _SMALLEST_FIXED <= exponent < 0 else 1


def _zeros_before(exponent: int) -> str:
    """Return the zeros and the point before the digits of a number below 1, after two characters."""
    return "\0\0" + f"0.{'0' * (-exponent - 1)}" if _SMALLEST_FIXED <= exponent < 0 else ""


def _exponent_text(exponent: int) -> str:
    """Return the exponent of a number that ``%g`` writes with one, after three characters."""
    return "" if _SMALLEST_FIXED <= exponent < _DIGITS else f"\0\0\0e{exponent:+03d}"


@cache
def _forms() -> tuple[Words, Words, Words]:
    """Return bits (2, forms) of ten digits that stay where they are, that move on by one character, and of the point.

    A form is 11 times the digits before the point, 0 where all are behind a point that is written already, and
    the digits that are kept.
    """
    # A mask of the characters of two words is one whole number, eight bits a character, the first in the lowest.
    bits = []
    for before in range(_DIGITS + 1):
        stay = (1 << _BYTE_BITS * before) - 1
        for kept in range(_DIGITS + 1):
            if before == 0 or kept <= before:
                bits.append([(1 << _BYTE_BITS * max(kept, before)) - 1, 0, 0])
            else:
                move = ((1 << _BYTE_BITS * (kept + 1)) - 1) & ~(stay << _BYTE_BITS | 0xFF)
                bits.append([stay, move, ord(".") << _BYTE_BITS * before])
    words = np.array([[_two_words(part) for part in form] for form in bits], np.uint64)
    stays, moves, points = words.transpose(1, 2, 0)
    return stays.copy(), moves.copy(), points.copy()


def _exponent_index(exponent: NDArray[np.int64] | int) -> Any:
    """Return the index of a decimal exponent in the tables."""
    return exponent + _MAX_EXPONENT + 1


def _text_bits(text: str) -> int:
    """Return a text as a number, its first character in the lowest byte."""
    return int.from_bytes(text.encode("ascii"), "little")


def _two_words(bits: int) -> tuple[int, int]:
    """Return the lower and the upper word of a number."""
    return bits & (2**_WORD_BITS - 1), bits >> _WORD_BITS
