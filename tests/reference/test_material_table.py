"""Tables of instruments: what is read, and what is refused or asked for, with line and column."""

import json
import math
import time

import numpy as np
import pytest
from palpate import LogError
from palpate_reference.instrument_text import read_text
from palpate_reference.material_table import TableSettings
from palpate_reference.table_columns import name_and_unit
from palpate_reference.table_reader import read_tables

NOTHING = TableSettings({})
# In the form of an export of TRIOS 5.7 for a Discovery HR-30, of which a public file was seen; the numbers are ours.
TRIOS = """Filename,gel
Instrument name,5343-1581
Procedure name,Peak hold
,Frequency sweep
[File Parameters]
Instrument type,Discovery HR30
[step]
Peak hold - 1
Stress,Shear rate,Viscosity,Step time,Temperature
Pa,1/s,Pa.s,min,°C
47.86,161.863,0.296,0.0168667,20.00

[step]
Frequency sweep - 2
Angular frequency,Storage modulus,Loss modulus,Oscillation strain,Step time,Temperature
rad/s,kPa,kPa,%,min,°C
0.1,10.0,1.0,0.5,1.0,20.00
1,11.0,1.5,0.5,2.0,20.01

[step]
Stress relaxation - 3
Step time,Relaxation modulus,Stress,Strain
min,Pa,Pa,%
0.0,12000,120,1.0
0.5,9000,90,1.0
1.0,8000,80,1.0

"""
# In the LIMS form of TRIOS 5.1 for an ARES-G2, of which a public file was seen.
LIMS = """[Version]
TA Instruments LIMS export format version\t0
[Parameters: File Parameters]
Instrument type\tAresG2
[Step]
Step name\tFrequency sweep (150.0 °C)
Number of points\t2
Variables\tTemperature\tAngular frequency\tStress\tComplex viscosity\tBits\tFrequency\tStorage modulus\tLoss modulus
Units\t°C\trad/s\tMPa\tPa.s\t\tHz\tMPa\tMPa
Data point\t150.0\t0.6283185\t-1E-06\t7957.747\t0xB6453\t0.1\t0.003\t0.004
Data point\t149.9\t6.283185\t-2E-06\t2250.79\t0xB6453\t1.0\t0.01\t0.01
"""
# In the form of a public CSV of RheoCompass for an MCR: a time sweep while a gel cures, then a stress relaxation.
CURE = """Project:,gel,,,,,
,,,,,,
Result:,UV Cure,,,,,
,,,,,,
Interval and data points:,1,2,,,,
Interval data:,Point No.,Time,Test Time,Storage Modulus,Loss Modulus,Status,Shear Strain,Shear Stress
,,,,,,
,,[s],[s],[Pa],[Pa],,[%],[Pa]
,1,1,181,3.7,6.6,"ME-,WMa,TruStrain™",0.999,0.0766
,2,2,182,5.4,7.0,"WMa,TruStrain™",1,0.0891
,,,,,,
Result:,Stress Relaxation,,,,,
,,,,,,
Interval and data points:,1,4,,,,
Interval data:,Point No.,Time,Test Time,Storage Modulus,Loss Modulus,Status,Shear Strain,Shear Stress
,,,,,,
,,[s],[s],[Pa],[Pa],,[%],[Pa]
,1,0.2,509,,,Dy_auto,10,400
,2,0.4,509.2,,,Dy_auto,10,380
,3,0.8,509.6,,,Dy_auto,10,370
,4,1.6,510.4,,,Dy_auto,10,365
"""
# In the form that public readers of RheoCompass exports describe.
RHEOCOMPASS = (
    "Project:\tgel\nTest:\tA\nResult:\tFrequency sweep 1\n\nInterval and data points:\t1\t2\n"
    "Interval data:\tPoint No.\tFrequency\tStorage Modulus\tLoss Modulus\tShear Strain\n\t\t\t\t\t\n"
    "\t\t[Hz]\t[kPa]\t[kPa]\t[%]\n\t1\t0,1\t10,5\t1,2\t0,5\n\t2\t1,0\t11,5\t1,5\t0,5\n"
)


def written(folder, text, name="table.csv", encoding="utf-8"):
    path = folder / name
    path.write_text(text, encoding=encoding)
    return path


def test_steps_of_trios(tmp_path):
    """The flow curve is left out; moduli are of shear, since the instrument is a rheometer; of the times the step's."""
    sweep, relaxation = read_tables(written(tmp_path, TRIOS), NOTHING)
    assert (sweep.kind, sweep.title, sweep.format, sweep.shear) == ("oscillation", "Frequency sweep - 2", "TRIOS", True)
    np.testing.assert_allclose(sweep.x, [0.1 / (2 * math.pi), 1 / (2 * math.pi)])
    np.testing.assert_allclose(sweep.y, [[10e3, 1e3], [11e3, 1.5e3]])
    np.testing.assert_allclose(sweep.strain, 0.005)
    np.testing.assert_allclose(sweep.temperature, [20.0, 20.01])
    np.testing.assert_allclose(relaxation.x, [30.0, 60.0])  # the instant of the step itself has no modulus
    np.testing.assert_allclose(relaxation.y[:, 0], [9e3, 8e3])


def test_steps_of_the_lims_form(tmp_path):
    """Names, units and rows by the words before them; the stress in between is no modulus, nor is a status a number."""
    (sweep,) = read_tables(written(tmp_path, LIMS, "sweep.txt"), NOTHING)
    assert (sweep.kind, sweep.title, sweep.shear) == ("oscillation", "Frequency sweep (150.0 °C)", True)
    np.testing.assert_allclose(sweep.x, [0.1, 1.0])
    np.testing.assert_allclose(sweep.y, [[3e3, 4e3], [1e4, 1e4]])
    np.testing.assert_allclose(sweep.temperature, [150.0, 149.9])


def test_a_relaxation_is_stress_over_the_strain_that_is_held(tmp_path):
    """Of the interval's own time; the modulus over time before it, at one frequency that is not stated, is left out."""
    (table,) = read_tables(written(tmp_path, CURE), NOTHING)
    assert (table.kind, table.title, table.shear) == ("relaxation", "Stress Relaxation, interval 1", True)
    np.testing.assert_allclose(table.x, [0.2, 0.4, 0.8, 1.6])
    np.testing.assert_allclose(table.y[:, 0], [4000, 3800, 3700, 3650])
    assert table.notes == ("stress over the strain that is held",)
    flowing = "time [s],shear strain [%],shear stress [Pa],shear rate [1/s]\n1,10,4,0\n2,10,3,0\n3,10,2,0\n"
    assert read_tables(written(tmp_path, flowing), NOTHING)[0].kind == "relaxation"
    with pytest.raises(LogError, match="no table of a material"):  # a steady flow under a steady stress
        read_tables(
            written(
                tmp_path,
                flowing.replace("1,10,4,0", "1,11,2,5").replace("2,10,3,0", "2,15,2,5").replace("3,10,2,0", "3,19,2,5"),
            ),
            NOTHING,
        )


# In the form of a public creep by TRIOS: compliance and modulus of every row, nothing yet at the instant of the step.
CREEP = """Instrument type\tDiscovery HR2
[step]
Creep - 1
Step time\tTemperature\tTime\tStress\tShear rate\tStrain\tViscosity\tDate and time\tCompliance\tModulus
min\t°C\tmin\tMPa\t1/s\t%\tPa.s\t\t1/MPa\tMPa
0\t44.98\t0\t0.0005\t-0.0085\t0\t-58388.7\t10/17/2022 10:27:02 AM\t0\t0
0.05\t44.98\t0.05\t0.0005\t0.08\t5\t5667.0\t10/17/2022 10:27:05 AM\t100\t0.01
0.1\t44.98\t0.1\t0.0005\t0.27\t10\t1835.2\t10/17/2022 10:27:08 AM\t200\t0.005
0.2\t44.98\t0.2\t0.0005\t0.55\t15\t893.5\t10/17/2022 10:27:14 AM\t300\t0.00333
"""


def test_a_creep_by_trios(tmp_path):
    """By the stress that is held, though the modulus stands there, too; the row of the step itself is left out."""
    (table,) = read_tables(written(tmp_path, CREEP, "creep.txt"), NOTHING)
    assert (table.kind, table.title, table.shear) == ("creep", "Creep - 1", True)
    np.testing.assert_allclose(table.x, [3.0, 6.0, 12.0])
    np.testing.assert_allclose(table.y[:, 0], [1e-4, 2e-4, 3e-4])
    for title in ("Peak hold - 1", "Flow ramp - 1"):
        with pytest.raises(LogError, match="no table of a material"):
            read_tables(written(tmp_path, CREEP.replace("Creep - 1", title), "flow.txt"), NOTHING)


def test_a_creep_is_strain_over_the_stress_that_is_held(tmp_path):
    """The first row, in which the stress still rises, is left out; a ramp of both remains stress over strain."""
    text = "time [s],shear strain [%],shear stress [Pa]\n0.1,0.5,80\n"
    text += "".join(f"{t},{100 * 1e-4 * t**0.5},100\n" for t in range(1, 6))
    (table,) = read_tables(written(tmp_path, text), NOTHING)
    assert (table.kind, table.shear) == ("creep", True)
    np.testing.assert_allclose(table.y[:, 0], 1e-6 * np.arange(1, 6) ** 0.5)
    stiff = "time [s],shear strain [%],shear stress [Pa]\n" + "".join(f"{t},{1 + t / 1e4},100\n" for t in range(1, 6))
    (table,) = read_tables(written(tmp_path, stiff), NOTHING)
    assert table.kind == "creep"
    ramp = "time [s],strain [%],stress [kPa]\n1,1,2\n2,2,4\n3,3,6\n"
    (table,) = read_tables(written(tmp_path, ramp), NOTHING)
    assert table.kind == "stress-strain"


@pytest.mark.parametrize("encoding", ["utf-16", "utf-8"])
@pytest.mark.parametrize("comma", [True, False], ids=["commas", "points"])
def test_intervals_of_rheocompass(tmp_path, encoding, comma):
    text = RHEOCOMPASS if comma else RHEOCOMPASS.replace(",", ".")
    (table,) = read_tables(written(tmp_path, text, encoding=encoding), NOTHING)
    assert (table.kind, table.title, table.shear) == ("oscillation", "Frequency sweep 1, interval 1", True)
    np.testing.assert_allclose(table.x, [0.1, 1.0])
    np.testing.assert_allclose(table.y, [[10.5e3, 1.2e3], [11.5e3, 1.5e3]])


@pytest.mark.parametrize(
    ("text", "kind", "shear", "x", "y"),
    [
        ("f (Hz);G' (Pa);G\" (Pa)\n1;200;30\n2;210;31\n", "oscillation", True, [1, 2], [[200, 30], [210, 31]]),
        ("Freq\tE'\tE''\nrad/s\tMPa\tMPa\n6.283185307179586\t2\t1\n12\t2\t1\n", "oscillation", False, 1, [2e6, 1e6]),
        ("Freq\tG'\tG\"\nHz\tPa\tPa\n   1    2E5   1E5\n  3  3E5    2E5\n", "oscillation", True, [1, 3], [[2e5, 1e5]]),
        ("time [ms],G(t) [kPa]\n10,3\n20,2\n", "relaxation", True, [0.01, 0.02], [[3e3], [2e3]]),
        ("time [s],Creep compliance [1/MPa]\n1,3\n2,4\n", "creep", True, [1, 2], [[3e-6], [4e-6]]),
        ("# strain  stress\n# %  kPa\n1 2\n2 4\n", "stress-strain", False, [0.01, 0.02], [[2e3], [4e3]]),
    ],
)
def test_any_table_with_names_and_units(tmp_path, text, kind, shear, x, y):
    (table,) = read_tables(written(tmp_path, text), TableSettings({}, True if kind == "creep" else None))
    assert (table.kind, table.shear) == (kind, shear)
    np.testing.assert_allclose(table.x[: np.size(x)], x)
    np.testing.assert_allclose(table.y[: len(np.atleast_2d(y))], np.atleast_2d(y))


def test_uncertainties_of_the_table_itself(tmp_path):
    """As in what `palpate fit spectrum` and `palpate fit relaxation` write."""
    text = "frequency_Hz,G_storage_Pa,G_storage_std_Pa,G_loss_Pa,G_loss_std_Pa,E_storage_Pa\n1,200,3,30,2,600\n"
    (table,) = read_tables(written(tmp_path, text), NOTHING)
    assert table.shear
    np.testing.assert_array_equal(table.std, [[3.0, 2.0]])
    (table,) = read_tables(written(tmp_path, "time_s,E_Pa,E_std_Pa\n1,600,9\n"), NOTHING)
    assert (table.kind, table.shear, table.std.tolist()) == ("relaxation", False, [[9.0]])


SWEEP = "Frequency,G',G''\nHz,Pa,Pa\n1,200,30\n10,210,31\n"


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (SWEEP.replace("Hz,Pa,Pa\n", ""), "table.csv:1, column 1 'Frequency': has no unit: state it with --unit"),
        (SWEEP.replace("Hz,Pa,Pa", "Hz,,Pa"), 'table.csv:1, column 2 "G\'": has no unit'),
        (SWEEP.replace("210", "-210"), 'table.csv:4, column 2 "G\'": -210 is not above zero'),
        (SWEEP.replace("31", "0"), "table.csv:4, column 3 \"G''\": 0 is not above zero"),
        (SWEEP.replace("1,200", "-1,200"), "table.csv:3, column 1 'Frequency': -1 is not above zero"),
        (SWEEP.replace("210", "nan"), "table.csv:4, column 2 \"G'\": 'nan' is not a finite number"),
        (SWEEP.replace("210", "high"), "table.csv:4, column 2 \"G'\": 'high' is not a number"),
        (SWEEP.replace(",31", ""), "table.csv:4, column 3 \"G''\": the line ends before it"),
        (SWEEP.replace("Hz", "mm"), "table.csv:1, column 1 'Frequency': '1 mm' is a length, not a frequency"),
        (SWEEP.replace("Frequency", "Angular frequency"), "an angular frequency is in rad/s, and Hz is stated"),
        (SWEEP.replace("1,200", "6.2832,200").replace("10,210", "62.832,210"), "are they rad/s? State which"),
        (SWEEP.replace("G',G''", "Storage modulus,Loss modulus"), "State --modulus shear or --modulus young"),
        ("Strain,Stress [kPa]\n1,2\n", 'column 1 \'Strain\': has no unit: state it with --unit "Strain=%" or "1"'),
        ("Strain [1],Stress [kPa]\n1,2\n15,20\n", "table.csv:3, column 1 'Strain [1]': a strain of 15 is 1500 %"),
        ("a,b\n1,2\n", "table.csv:1: no table of a material"),
        ("1;2\n3;4\n", "table.csv:1: no table of a material"),
        ("f [Hz];G' [Pa];G'' [Pa]\n1,000;2,500;3,125\n", "can be one and a fraction or a thousand"),
        ("", "is empty"),
        ("nothing here\n", "the file contains no table"),
        (TRIOS[: TRIOS.index("Angular")], "the file ends in this step"),
        (RHEOCOMPASS[:-21], "states 2 points, but has 1: the file is cut short"),
        (LIMS[: LIMS.index("Data point\t149")], "table.csv:7: states 2 points, but has 1: the file is cut short"),
    ],
)
def test_what_cannot_be_read_is_refused_or_asked_for(palpate, tmp_path, text, said):
    written(tmp_path, text)
    done = palpate("material", "table.csv")
    assert done.returncode == 2
    assert said in done.stderr
    assert "Traceback" not in done.stderr


def test_the_complex_viscosity_tells_hz_from_radians(tmp_path):
    """|eta*| = |G*|/omega: a frequency that is rad/s under the name of Hz contradicts the column beside it."""
    size = math.hypot(300.0, 400.0)
    text = f"Frequency [Hz],G' [Pa],G'' [Pa],|Eta*| [Pa.s]\n5,300,400,{size / 5}\n7,300,400,{size / 7}\n"
    with pytest.raises(LogError, match=r"2 pi: rad/s was taken for Hz"):
        read_tables(written(tmp_path, text), NOTHING)
    assert len(read_tables(written(tmp_path, text.replace("[Hz]", "[rad/s]")), NOTHING)) == 1


def test_what_is_asked_for_can_be_stated(palpate, tmp_path):
    written(tmp_path, "Frequency,Storage modulus,Loss modulus\n6.2832,2,3\n62.832,2,3\n")
    units = ["--unit", "Frequency=Hz", "--unit", "Storage modulus=kPa", "--unit", "Loss modulus=kPa"]
    done = palpate("material", "table.csv", *units, "--modulus", "young", "--json")
    (table,) = json.loads(done.stdout)["tables"]
    assert (table["x"], table["shear"], table["y"]) == ([6.2832, 62.832], False, [[2e3, 3e3]] * 2)
    done = palpate("material", "table.csv", "--unit", "Freqency=Hz")
    assert done.returncode == 2
    assert "no column 'Freqency'; did you mean 'Frequency'?" in done.stderr
    assert palpate("material", "table.csv", "--unit", "Hz").returncode == 2


def test_a_file_that_is_no_text(tmp_path):
    path = tmp_path / "x.tri"
    path.write_bytes(bytes(range(256)))
    with pytest.raises(LogError, match="is a binary file and no text"):
        read_text(path)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (
            TRIOS,
            [
                "# Frequency sweep - 2: oscillation, 2 rows of G', G''",
                "palpate material agree RUN --reference table.csv",
            ],
        ),
        (CURE, ["# Stress Relaxation, interval 1: relaxation, 4 rows of G(t) over 0.2 to 1.6 s"]),
        (SWEEP.replace("Hz,Pa,Pa", "Hz,,Pa"), ['# fill in the unit of "G\'": Pa', "--unit 'G'\"'\"'=...'"]),
        (SWEEP.replace("Hz,Pa,Pa\n", ""), ["# fill in the unit of 'Frequency': Hz, rad/s", "--unit Frequency=..."]),
        (SWEEP.replace("G',G''", "Storage modulus,Loss modulus"), ["palpate material table.csv --modulus ..."]),
        ("strain [%],stress [Pa]\n1,2\n2,4\n", ["palpate material fit table.csv --scale '2 %' --loading ..."]),
        (SWEEP.replace("210", "-210"), ["# to be settled: table.csv:4, column 2"]),
    ],
)
def test_info_suggests_commands(palpate, tmp_path, text, said):
    written(tmp_path, text)
    done = palpate("info", "table.csv", "--suggest")
    assert done.returncode == 0, done.stderr
    for words in said:
        assert words in done.stdout


@pytest.mark.slow
def test_a_log_is_no_table_of_an_instrument(palpate, tmp_path):
    """Force and travel beside stress and strain, or columns of one letter, are those of a press; nor is a pipeline
    written for a table."""
    rows = "\n".join(f"{0.01 * k},{0.1 * k**1.5},{0.01 * k},{k},{0.1 * k}" for k in range(1, 60))
    for head in ("time [s],load [N],extension [mm],stress [kPa],strain [%]", "t [s],F [N],z [mm],E [kPa],s [1]"):
        written(tmp_path, f"{head}\n{rows}\n")
        assert "a table of an instrument" not in palpate("info", "table.csv", "--suggest").stdout
    written(tmp_path, SWEEP)
    done = palpate("info", "table.csv", "--suggest", "-o", "x.toml")
    assert done.returncode == 2
    assert "is not a log: no pipeline reads it" in done.stderr
    found = json.loads(palpate("info", "table.csv", "--suggest", "--json").stdout)
    assert found["commands"][0] == "palpate material table.csv"


def test_a_name_of_brackets_takes_no_time():
    """Its square took minutes of `palpate info --suggest`."""
    began = time.process_time()
    assert name_and_unit("[" * 80_000) == ("[" * 80_000, "")
    assert time.process_time() - began < 1.0
