"""Units of tables: with the tip that was given, from comments, as a person states them; numbers of other programs."""

import numpy as np
import palpate as python
import pytest
from palpate import ConfigurationError
from palpate_engine import registry
from palpate_fits.file_pipelines import file_groups
from palpate_kit.curves.alike_logs import LogPart
from palpate_kit.curves.file_facts import FileFacts
from palpate_kit.curves.stated_facts import stated_facts
from palpate_kit.logs.suggestion import force_unit, length_unit, tip_of

from tests.fits.test_fit_files import rows_of


def press(radius, modulus, deepest, n=800):
    """Time [s], height [m] and force [N] of a press with a sphere, 0.5 s of air before it."""
    time = np.arange(n) / 200
    depth = np.interp(time, [0, 0.5, 2.5, 4], [-0.2, -0.2, 1, -0.2]) * deepest
    random = np.random.default_rng(5)
    force = 16 / 9 * modulus * np.sqrt(radius) * np.maximum(depth, 0) ** 1.5
    return time, -depth, force + 1e-3 * force.max() * random.standard_normal(n)


def read_as(tmp_path, text, tip, **facts):
    """The columns of the device that a table is read by, and what is asked of it."""
    file = tmp_path / "a.txt"
    file.write_text(text)
    stated = stated_facts([file], [f"rig.tip={tip}"]).with_facts(**facts)
    groups = file_groups([LogPart(file)], FileFacts(stated), {}, {})
    assert groups.read, groups.refused
    device = groups.read[0].pipeline.devices["log"]
    return {name: (column.unit, column.scale) for name, column in device.columns.items()}, groups.questions


def table(head, *columns, separator=","):
    rows = (separator.join(f"{x:.9g}" for x in row) for row in zip(*columns, strict=True))
    return "\n".join([*([head] if head else []), *rows]) + "\n"


SCALES = {"m": 1, "mm": 1e3, "um": 1e6, "nm": 1e9, "N": 1, "mN": 1e3, "uN": 1e6, "nN": 1e9}


@pytest.mark.parametrize(
    ("radius", "modulus", "deepest", "lengths", "forces"),
    [
        (3e-3, 5e4, 1.5e-3, ("m", "mm", "um"), ("N", "mN")),
        (5e-6, 5e3, 1e-6, ("m", "um", "nm"), ("N", "uN", "nN")),
        (50e-6, 1e5, 1e-5, ("m", "um", "nm"), ("N", "mN", "uN")),
    ],
)
def test_units_that_nothing_states_are_those_that_fit_the_tip(tmp_path, radius, modulus, deepest, lengths, forces):
    time, height, force = press(radius, modulus, deepest)
    tip = tip_of({"tip": f"paraboloid {1e6 * radius:g} um"})
    for length in lengths:
        assert length_unit(float(np.ptp(height)) * SCALES[length], tip) == length
    plausible = {unit: force_unit(float(np.ptp(force)) * SCALES[unit], float(np.ptp(height)), tip) for unit in forces}
    assert all(50 <= pascal <= 5e7 for _, pascal in plausible.values())
    text = table("time,force,height", time, force, height)
    columns, questions = read_as(tmp_path, text, f"paraboloid {1e6 * radius:g} um")
    assert columns["position"] == ("m", 1.0)
    assert next(iter(questions.values())).guess in ("m", "N", "mN", "uN", "nN")  # a guess is a question


def test_a_tip_of_five_micrometres_measures_five_kilopascals(tmp_path, monkeypatch, palpate):
    """Names and units stand in comments: without them the forces were taken for kilonewtons."""
    monkeypatch.chdir(tmp_path)
    time, height, force = press(5e-6, 5e3, 1e-6)
    head = "# segment: extend\n# columns: tip deflection seriesTime\n# units: m N s\n#"
    (tmp_path / "a.txt").write_text(table(head, height, force, time, separator=" "))
    done = palpate("fit", "a.txt", "--tip", "paraboloid 5 um", "--tip-mass", "0 g", "--out", "out")
    assert done.returncode == 0, done.stderr
    assert float(rows_of(tmp_path / "out")["a"]["elasticity"]) == pytest.approx(5e3, rel=0.03)
    assert "a guess" not in done.stderr


@pytest.mark.parametrize(
    "head",
    [
        "# columns: t F z\n# units: s mN um",
        "# units: s, mN, um\n# columns: t, F, z",
        '# columns: "Series Time" "Force" "Height"\n# units: s mN um',
        "t in s,F in mN,z in um",
        "t [s],F [mN],z [um]",
        "t (s),F (mN),z (um)",
        "t/s,F/mN,z/um",
        "t / s,F / mN,z / um",
    ],
)
def test_units_above_a_table_are_read_in_every_form(tmp_path, head):
    time, height, force = press(3e-3, 5e4, 1.5e-3)
    columns, questions = read_as(tmp_path, table(head, time, 1e3 * force, 1e6 * height), "paraboloid 3 mm")
    assert (columns["force"], columns["position"]) == (("mN", 1.0), ("um", 1.0))
    assert not questions


def test_a_person_states_the_unit_of_a_column_that_states_none_and_no_other(tmp_path):
    time, height, force = press(3e-3, 5e4, 1.5e-3)
    text = table("time,bridge [V],z", time, force / 10, 1e3 * height)
    columns, questions = read_as(tmp_path, text, "paraboloid 3 mm", units={"bridge [V]": "10 N", "z": "mm"})
    assert (columns["force"], columns["position"]) == (("N", 10.0), ("mm", 1.0))
    assert not questions
    text = table("time,force [mN],z [um]", time, 1e3 * force, 1e6 * height)
    columns, _ = read_as(tmp_path, text, "paraboloid 3 mm", units={"force [mN]": "N", "z [um]": "mm"})
    assert (columns["force"], columns["position"]) == (("mN", 1.0), ("um", 1.0))  # the file's own word
    with pytest.raises(ConfigurationError, match="must be a text"):
        stated_facts([tmp_path], ()).with_facts(units={"z": 3})


def test_exponents_of_fortran_are_numbers_and_marks_of_overload_are_missing_with_a_note(tmp_path):
    time, height, force = press(3e-3, 5e4, 1.5e-3)
    rows = [f"{t:.4f},{f:.6E},{1e3 * z:.6f}".replace("E", "D") for t, f, z in zip(time, force, height, strict=True)]
    for row, mark in ((100, "OVER"), (101, "#NV"), (102, "***")):
        t, _, z = rows[row].split(",")
        rows[row] = f"{t},{mark},{z}"
    file = tmp_path / "a.csv"
    file.write_text("\n".join(["time (s),force (N),height (mm)", *rows]))
    record = python.read(file)
    readings = next(iter(record.readings.values()))
    missing = np.flatnonzero(~np.isfinite(readings.values).all(axis=1))
    assert missing.tolist() == [100, 101, 102]
    kept = np.isfinite(readings.values).all(axis=1)
    column = [channel.name for channel in _device(record).streams[0].channels].index("force")
    np.testing.assert_allclose(readings.values[kept, column], force[kept], rtol=1e-5)
    device = _device(record)
    with device.connect(0) as link:
        list(link.batches())
    assert device.warnings == ("a.csv: 3 cells hold a mark of overload, and no reading",)


def _device(record):
    table = dict(record.devices["log"])
    part = registry.load().find("device", table.pop("type"))
    return part.model_validate(table)
