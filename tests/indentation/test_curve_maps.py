"""Files of many curves: each is a row by its number, with its place, and the picture of the map has a cell for it."""

import csv
import json
import tracemalloc
import warnings
import zipfile
from pathlib import Path

import numpy as np
import pytest
from palpate import LogError
from palpate_kit.curves.alike_logs import specimens_of
from palpate_kit.curves.curve_table import rows_of_fits
from palpate_logs import AfmReplay
from palpate_logs.curve_file import curve_file
from palpate_logs.jpk_curves import segment_kinds
from palpate_maps.curve_cells import axis_step, read_curve_cells

with warnings.catch_warnings():
    warnings.simplefilter("ignore")
    afmformats = pytest.importorskip("afmformats", reason="afmformats is not installed")

from tests.indentation.map_files import hdf5_file, jpk_file, press

GRID = (3, 2)
PRESSES = {k: press(3000.0 + 100.0 * k, k) for k in range(6)}
WRITERS = {"a map.jpk-force-map": jpk_file, "q.jpk-qi-data": jpk_file, "m.h5": hdf5_file}
TIP = ["--tip", "paraboloid 5 um", "--no-pictures"]


def table(path):
    """The rows of a CSV file."""
    with path.open() as file:
        return list(csv.DictReader(file))


@pytest.fixture
def fitted(palpate):
    """The rows of a fit, and its exit code."""

    def fit(source, folder, *options):
        code = palpate("fit", source, *TIP, "--out", folder, *options).returncode
        return [row for _, row in rows_of_fits(folder / "fits.csv")], code

    return fit


@pytest.mark.parametrize("name", WRITERS)
def test_a_map_holds_curves_by_number_at_their_places(tmp_path, name):
    """A curve that is missing leaves its number out, and the others keep theirs."""
    presses = {k: curve for k, curve in PRESSES.items() if k != 1}
    path = WRITERS[name](tmp_path / name, presses, GRID)
    assert AfmReplay.recognises(path)
    assert AfmReplay.records(path, {}) == ("0", "2", "3", "4", "5")
    places = AfmReplay.places(path)
    assert places["5"] == pytest.approx((2e-6, 1e-6))
    assert places["3"] == pytest.approx((0.0, 1e-6))


@pytest.mark.parametrize("grid", [None, GRID])
def test_numbers_of_jpk_are_those_of_afmformats(tmp_path, grid):
    """Bit for bit: whole numbers, scales, times and segments."""
    presses = PRESSES if grid else {0: PRESSES[3]}
    path = jpk_file(tmp_path / f"m.jpk-force{'-map' if grid else ''}", presses, grid)
    file = curve_file(path)
    for number, expected in zip(file.numbers, afmformats.load_data(path), strict=True):
        curve = file.curve(number)
        for column in curve.columns:
            np.testing.assert_array_equal(curve.column(column), expected[column])
        assert curve.spring_constant == expected.metadata["spring constant"]
        assert curve.approach_duration == expected.metadata["duration approach"]


@pytest.mark.slow
@pytest.mark.parametrize(("name", "single"), [("a map.jpk-force-map", "one.jpk-force"), ("m.h5", "one.h5")])
def test_each_curve_has_the_numbers_of_a_file_of_its_own(fitted, tmp_path, name, single):
    """Over a second: every curve of a map is fitted, and one of them again from its own file."""
    rows, code = fitted(WRITERS[name](tmp_path / name, PRESSES, GRID), tmp_path / "map")
    assert code == 0
    assert [Path(row["curve"]).name for row in rows] == [f"{name}:{k}" for k in range(6)]
    assert [(float(row["x"]), float(row["y"])) for row in rows[2:4]] == [(2e-6, 0.0), (0.0, 1e-6)]
    listed = table(tmp_path / "map" / "curves.csv")
    assert float(listed[5]["x_m"]) == 2e-6
    ((alone,), _) = fitted(WRITERS[name](tmp_path / single, {0: PRESSES[4]}), tmp_path / "one")
    differing = [key for key in alone if key not in ("curve", "x", "y", "settings") and alone[key] != rows[4][key]]
    assert differing == []
    for k, row in enumerate(rows):
        assert abs(float(row["elasticity"]) - 3000.0 - 100.0 * k) < 2 * float(row["elasticity_combined"])
    ((chosen,), _) = fitted(tmp_path / name, tmp_path / "chosen", "--curve", "4")
    assert chosen["elasticity"] == alone["elasticity"]


@pytest.mark.slow
def test_a_broken_curve_is_a_row_with_its_reason_and_a_cross_on_the_map(fitted, palpate, tmp_path):
    """Over a second: one curve lacks its channel, one all of its segments; the others are as they were."""
    path = jpk_file(tmp_path / "broken map.jpk-force-map", PRESSES, GRID, broken=(2,))
    with zipfile.ZipFile(path, "a") as archive:
        archive.writestr("index/6/", "")
    rows, code = fitted(path, tmp_path / "fits")
    assert code == 1
    errors = {row["curve"].rpartition(":")[2]: row["error"] for row in rows if row["error"]}
    assert errors["2"].endswith("curve 2: its force cannot be read: no channel vDeflection in segment 0")
    assert errors["6"].endswith("curve 6: has no segment")
    assert rows[2]["x"] == "2e-06"  # known, though it failed
    told = palpate("map", tmp_path / "fits")
    assert "map of 2 um x 1 um, 6 curves, 1 without elasticity" in told.stdout
    assert "no channel vDeflection" in told.stderr
    cells = table(tmp_path / "fits" / "maps" / "map.csv")
    assert [bool(cell["elasticity"]) for cell in cells] == [True, True, False, True, True, True]
    assert "no channel vDeflection" in cells[2]["without"]
    assert (tmp_path / "fits" / "maps" / "map.png").stat().st_size > 5000


@pytest.mark.slow
def test_a_map_file_becomes_a_map_by_one_command(palpate, tmp_path, monkeypatch):
    """Over a second: six curves are fitted, then drawn."""
    monkeypatch.chdir(tmp_path)
    path = jpk_file(tmp_path / "m.jpk-qi-data", PRESSES, GRID)
    answer = json.loads(palpate("map", path.name, "--tip", "paraboloid 5 um", "--thickness", "20 um", "--json").stdout)
    assert (answer["kind"], answer["curves"], answer["without"]) == ("cells", 6, {})
    (folder,) = Path("runs").iterdir()
    with np.load(folder / "maps" / "map.npz") as arrays:
        np.testing.assert_allclose(arrays["x"], [0.0, 1e-6, 2e-6])
        assert arrays["value"].shape == arrays["combined"].shape == (2, 3)
        assert (arrays["combined"] > 0).all()
        assert arrays["value"][1, 2] > arrays["value"][0, 0]
    assert "thickness" in (folder / "pipeline.toml").read_text()


@pytest.mark.parametrize("ending", ["jpk-force-map", "h5"])
def test_a_file_that_is_cut_off_ends_in_one_sentence(tmp_path, ending):
    whole = WRITERS["a map.jpk-force-map" if ending != "h5" else "m.h5"](tmp_path / f"w.{ending}", PRESSES, GRID)
    path = tmp_path / f"cut off.{ending}"
    path.write_bytes(whole.read_bytes()[: whole.stat().st_size // 2])
    with pytest.raises(LogError) as error:
        curve_file(path)
    words = str(error.value).removeprefix(str(path))
    assert "is cut off: the list of its curves is missing" in words or "truncated file" in words
    assert "\n" not in str(error.value)


def test_a_map_of_one_curve_is_one_curve(tmp_path):
    path = jpk_file(tmp_path / "m.jpk-force-map", {7: PRESSES[0]}, (9, 1))
    assert AfmReplay.records(path, {}) == ()
    assert AfmReplay.suggest(path, {}).device == {"type": "afm-replay", "file": str(path)}


def test_a_curve_that_is_not_there_is_named(tmp_path):
    path = jpk_file(tmp_path / "m.jpk-force-map", PRESSES, GRID)
    with (
        pytest.raises(LogError, match="no curve 9; it contains 6, 0 to 5"),
        AfmReplay(file=path, record="9").connect(0) as link,
    ):
        list(link.batches())


def test_curves_are_read_one_by_one(tmp_path):
    """Of a map of which ten times as many curves are read, the memory does not grow with them."""
    presses = {k: press(3000.0, k, 2000) for k in range(40)}
    path = jpk_file(tmp_path / "m.jpk-force-map", presses, (40, 1))
    file = curve_file(path)
    tracemalloc.start()
    for number in file.numbers:
        assert len(file.curve(number).force) == 4000
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 0.2 * 40 * 4000 * 8  # of all forces together


def test_an_uncalibrated_curve_says_so(tmp_path):
    """As a file whose spring constant was never determined: its force is in volts."""
    path = jpk_file(tmp_path / "m.jpk-force", {0: PRESSES[0]})
    other = tmp_path / "v.jpk-force"
    with zipfile.ZipFile(path) as whole, zipfile.ZipFile(other, "w") as changed:
        for entry in whole.namelist():
            content = whole.read(entry)
            if entry.endswith(".properties"):
                lines = content.decode().splitlines()
                content = "\n".join(line for line in lines if ".conversion.force." not in line).encode()
            changed.writestr(entry, content)
    with pytest.raises(LogError, match="vDeflection is not calibrated: the file states no force"):
        AfmReplay.survey(other)


@pytest.mark.parametrize(
    ("styles", "expected"),
    [
        (["extend", "retract"], (0, 1)),
        (["extend", "pause", "retract"], (0, 2, 1)),
        (["pause", "extend", "pause", "retract"], (3, 0, 2, 1)),
        (["extend", "extend", "pause", "retract"], (3, 0, 2, 1)),
        (["extend", "pause", "pause", "retract", "pause"], (0, 2, 2, 1, 1)),
    ],
)
def test_segments_are_what_their_styles_say(styles, expected):
    assert segment_kinds(styles) == expected


def test_records_of_a_map_are_specimens_with_places(tmp_path):
    from palpate_engine import registry

    path = hdf5_file(tmp_path / "m.h5", PRESSES, GRID)
    parts = specimens_of(path, registry.load())
    assert [part.name for part in parts] == [f"m.h5:{k}" for k in range(6)]
    assert parts[4].place == pytest.approx((1e-6, 1e-6))


def test_a_step_is_that_from_line_to_line():
    """Places of a stage that misses its target by a thousandth of the extent are in one line."""
    places = np.repeat([0.0, 2e-6, 4e-6], 5) + 1e-12 * np.arange(15)
    assert axis_step(places) == pytest.approx(2e-6, rel=1e-3)
    assert axis_step(np.full(4, 3.0)) == 0.0


def test_curves_off_a_grid_make_no_map(tmp_path):
    """Nothing is invented between places that are less than 1 mm apart."""
    (tmp_path / "fits.csv").write_text(
        "curve,track,elasticity,elasticity_std,elasticity_combined,elasticity_verdict,surface,surface_std,"
        "surface_combined,rms,samples,x,y,verdict,conditions,needs,flags,settings,error\n"
        + "".join(
            f"c{k},t,1000,1,1,good,0,0,0,0,9,{x},{y},good,,,,s,\n"
            for k, (x, y) in enumerate([(0, 0), (1e-6, 0), (2.4e-6, 3e-7), (5e-6, 1e-6), (5.1e-6, 4e-6)])
        )
    )
    (tmp_path / "pipeline.toml").write_text("")
    with pytest.raises(LogError, match="less than 1 mm apart and not on a grid"):
        read_curve_cells(tmp_path)
