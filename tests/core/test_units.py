"""People's units at the edge."""

import subprocess
import sys

import pytest
from palpate.units import to_si


@pytest.mark.parametrize(
    ("written", "unit", "expected"),
    [
        ("5 mm", "m", 0.005),
        ("22 ms", "s", 0.022),
        ("112.5 kPa", "Pa", 112500.0),
        ("362 Pa*s", "Pa*s", 362.0),
        ("0.01 N*s/mm", "N*s/m", 10.0),
        ("1.5 N/h", "N/s", 1.5 / 3600),
        ("4 mm/s", "m/s", 0.004),
        ("140 g", "kg", 0.14),
        ("2 Hz", "Hz", 2.0),
        ("-1e-3m", "m", -0.001),
        (".5 µm", "m", 5e-7),
        (3, "m", 3.0),
        (0.25, "N", 0.25),
    ],
)
def test_quantities_become_si(written, unit, expected):
    assert to_si(written, unit) == pytest.approx(expected, rel=1e-14)


@pytest.mark.parametrize(
    ("written", "unit", "complaint"),
    [
        ("5 kPa", "m", "is a pressure, not a length"),
        ("5", "m", "has no unit"),
        ("five mm", "m", "is not a length"),
        ("5 mmm mm", "m", "unknown unit"),
        ("5 quux", "m", "unknown unit 'quux'"),
        ("", "m", "is not a length"),
        (True, "m", "a length is wanted"),
        (None, "N", "a force is wanted"),
        (float("nan"), "m", "not a finite length"),
        ("1e999 mm", "m", "not a finite length"),
        ("__import__('os') mm", "m", "is not a length"),
    ],
)
def test_anything_else_is_refused_in_words(written, unit, complaint):
    with pytest.raises(ValueError, match=complaint):
        to_si(written, unit)


def test_what_people_write_is_read_as_pint_reads_it_to_the_bit():
    import pint
    from palpate.units import _UNITS

    registry = pint.UnitRegistry()
    for unit, row in _UNITS.items():
        for written in row.written:
            expected = registry.Quantity(0.37, registry.Unit(written)).to(unit).magnitude
            assert to_si(f"0.37 {written}", unit) == expected, written


def test_usual_units_are_read_without_pint():
    program = "import sys; from palpate.units import to_si; to_si('5 mm', 'm'); sys.exit('pint' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", program]).returncode == 0
