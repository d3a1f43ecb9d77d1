"""People's units at the edge."""

import re

import pytest
from palpate.units import _QUANTITIES, to_si


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
        (True, "m", "expected a length"),
        (None, "N", "expected a force"),
        (float("nan"), "m", "not a finite length"),
        ("1e999 mm", "m", "not a finite length"),
        ("__import__('os') mm", "m", "is not a length"),
    ],
)
def test_anything_else_is_refused_in_words(written, unit, complaint):
    with pytest.raises(ValueError, match=complaint):
        to_si(written, unit)


COMPOSED = {
    "m": ("nm", "km", "inch", "micron", "millimeter", "micrometers"),
    "s": ("ns", "seconds", "hour", "d"),
    "N": ("uN", "nN", "pN", "gf", "kgf", "dyn", "kg*m/s**2", "kg m / s^2"),
    "Pa": ("GPa", "bar", "mbar", "N/mm^2", "N / cm**2", "kilopascal"),
    "Pa*s": ("mPa*s", "Pa s", "Pa·s", "cP", "N s/m^2", "N/m^2*s"),
    "N*s/m": ("N*s/mm", "mN s/mm", "kg/s"),
    "N/m": ("mN/um", "N/(mm)", "kN/m"),
    "N/s^0.5": ("N/sqrt(h)", "mN/h^0.5"),
    "m/s": ("mm/min", "km/h", "mm s^-1"),
    "m/s^2": ("mm/s/s", "mm/(s*s)"),
    "rad": ("degrees", "mrad", "°"),
    "rad/s": ("rpm", "deg/min"),
    "Hz": ("MHz", "s^-1"),
    "N*m": ("N*mm",),
    "N*m/rad": ("N*mm/rad", "N*m/deg"),
    "kg*m^2": ("kg*cm^2", "g*m^2"),
    "V/N": ("mV/N",),
}


@pytest.mark.slow
def test_units_are_read_as_pint_reads_them_to_the_bit():
    import pint

    registry = pint.UnitRegistry()
    usual = {unit: row.usual for unit, row in _QUANTITIES.items()}
    for unit, written in [(si, text) for table in (usual, COMPOSED) for si in table for text in table[si]]:
        alike = written.replace("sqrt(h)", "h^0.5")
        expected = registry.Quantity(0.37, registry.Unit(alike)).to(unit).magnitude
        assert to_si(f"0.37 {written}", unit) == expected, written


@pytest.mark.parametrize(
    ("written", "unit", "meant"),
    [
        ("5 mmm", "m", "mm"),
        ("5 mn", "m", "mm"),
        ("5 mn", "N", "mN"),
        ("5 KPa", "Pa", "kPa"),
        ("5 hz", "Hz", "Hz"),
        ("5 Newtons", "N", "newtons"),
        ("5 kPas", "Pa*s", "kPa*s"),
    ],
)
def test_a_unit_that_was_meant_is_named(written, unit, meant):
    with pytest.raises(ValueError, match=re.escape(f'did you mean "{meant}"?')):
        to_si(written, unit)


@pytest.mark.parametrize("written", ["5 m)", "5 m*(m", "5 m)/(s"])
def test_parentheses_that_do_not_match_are_no_unit(written):
    with pytest.raises(ValueError, match="unknown unit"):
        to_si(written, "m")


def test_an_angle_is_no_pure_number_and_a_turn_no_frequency():
    with pytest.raises(ValueError, match="is an angular speed, not a frequency"):
        to_si("10 rad/s", "Hz")
    with pytest.raises(ValueError, match="is an angle, not a pure number"):
        to_si("10 deg", "1")
