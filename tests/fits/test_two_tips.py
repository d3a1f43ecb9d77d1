"""Two tips on one specimen: values that agree by E_n where the stated facts are right, and only there."""

import json
from types import SimpleNamespace

import numpy as np
import palpate_kit.curves.shared_specimen as shared
import pytest
from palpate_fits.name_groups import groups_of
from palpate_fits.setup_tables import pair_table
from palpate_kit.curves.shared_specimen import Setup, SetupPair, agreement_sentence, by_depth

MODULUS, HEIGHT = 50e3, 10e-3  # Pa, m
RIG = 'tip = "paraboloid 6 mm"\ndelay = "0 ms +- 0.2 ms"\ntip_mass = "0 g"\ntare = "free-air"\npoisson = 0.5\n'
RADII = {"small": 1e-3, "large": 6e-3}  # m
LAYER = ("--thickness", "10 mm", "--base", "bonded")


def press(radius, seed, deepest=1e-3):
    """Time [s], force [N] and height [mm] of a press of a paraboloid on a bonded layer, after air; noise 0.5 mN."""
    time = np.arange(400) / 200.0
    depth = np.interp(time, [0.0, 0.4, 1.0, 1.4, 2.0], [-0.4e-3, -0.1e-3, deepest, deepest, -0.4e-3])
    contact = np.maximum(depth, 0.0)
    x = np.sqrt(radius * contact) / HEIGHT
    layer = 1 + 1.133 * x + 1.283 * x**2 + 0.769 * x**3 + 0.0975 * x**4
    force = 16 / 9 * MODULUS * np.sqrt(radius) * contact**1.5 * layer
    return np.column_stack([time, force + 5e-4 * np.random.default_rng(seed).standard_normal(400), -1e3 * depth])


def write(path, table):
    np.savetxt(path, table, delimiter=",", header="time (s),force (N),height (mm)", comments="", fmt="%.9g")


@pytest.fixture
def gel(tmp_path, monkeypatch):
    """Records of one specimen by two tips, and of another one by one."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "gel").mkdir()
    for seed, (name, radius) in enumerate(RADII.items()):
        write(f"gel/{name}.csv", press(radius, seed))
    write("gel/other.csv", press(RADII["small"], 5))
    rows = [f"{name}.csv,G1,paraboloid {1e3 * radius:g} mm" for name, radius in RADII.items()]
    (tmp_path / "gel" / "rig.toml").write_text(RIG)
    (tmp_path / "gel" / "curves.csv").write_text(
        "\n".join(["curve,specimen,tip", *rows, "other.csv,G2,paraboloid 1 mm"])
    )
    return tmp_path


def fit(palpate, *words):
    done = palpate("fit", *words)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.slow
def test_a_layer_taken_for_a_half_space_is_seen_by_a_second_tip(palpate, gel):
    wrong = fit(palpate, "gel", "--thickness", "half-space", "-o", "fits")
    assert "two tips or depths on one specimen" in wrong
    assert "E_n is beyond 1 (G1): a fact of rig or specimen is wrong" in " ".join(wrong.split())
    assert "most likely tip, thickness or base" in " ".join(wrong.split())
    mended = json.loads(fit(palpate, "gel", *LAYER, "--json", "-o", "layer"))["specimens"]
    (pair,) = mended["pairs"]
    assert (pair["specimen"], {setup["tip"] for setup in pair["setups"]}) == (
        "G1",
        {"paraboloid 1 mm", "paraboloid 6 mm"},
    )
    (one, other) = (setup["values"]["elasticity"] for setup in pair["setups"])
    apart = abs(one["value"] - other["value"]) / (2 * np.hypot(one["combined"], other["combined"]))
    assert pair["e_n"]["elasticity"] == pytest.approx(apart)
    assert apart < 1
    assert mended["says"] == "E_n is at most 1: the stated facts of rig and specimen agree within the ±"
    # A folder of fits says the same when a fact of it is stated.
    assert mended["says"] in fit(palpate, "fits", *LAYER)


@pytest.mark.slow
def test_the_specimen_may_be_in_the_names_and_another_depth_is_another_setup(palpate, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for seed, deepest in enumerate((0.5e-3, 1e-3, 1.05e-3)):
        write(f"G1_{seed}.csv", press(RADII["large"], seed, deepest))
    files = sorted(path.name for path in tmp_path.glob("*.csv"))
    (tmp_path / "rig.toml").write_text(RIG)
    options = (*LAYER, "--by", "(?P<specimen>G\\d)_")
    (pair,) = json.loads(fit(palpate, *files, *options, "--json", "-o", "fits"))["specimens"]["pairs"]
    assert [setup["curves"] for setup in pair["setups"]] == [["G1_0.csv"], ["G1_1.csv", "G1_2.csv"]]
    assert pair["e_n"]["elasticity"] < 1


def setup(value, depth=1e-3, curves=("a",)):
    return Setup("sphere 1 mm", depth, curves, {"elasticity": (value, 1.0)})


def pair_of(score, name="elasticity", specimen="G1"):
    return SetupPair(specimen, "dr/fit", (setup(1.0), setup(2.0)), {name: score})


@pytest.mark.parametrize(
    ("pairs", "words"),
    [
        ([], ""),
        ([pair_of(1.0)], "E_n is at most 1: the stated facts"),
        (
            [pair_of(1.01)],
            "beyond 1 (G1): a fact of rig or specimen is wrong for at least one of them, most likely tip",
        ),
        ([pair_of(2.0, "viscosity")], "most likely the delay"),
        ([pair_of(2.0, specimen="G2"), pair_of(0.3)], "beyond 1 in 1 of 2 pairs (G2)"),
    ],
)
def test_one_sentence_says_what_the_pairs_show(pairs, words):
    assert words in agreement_sentence(pairs)


def test_records_to_about_the_same_depth_repeat_one_another():
    rows = [SimpleNamespace(number=lambda _, depth=depth: depth) for depth in (2.0, 1.0, 1.2, None, 2.4, 3.0)]
    assert [[row.number("deepest") for row in group] for group in by_depth(rows)] == [
        [None],
        [1.0, 1.2],
        [2.0, 2.4],
        [3.0],
    ]


def test_repeats_do_not_shrink_what_they_share():
    row = SimpleNamespace(
        curve="a",
        usable_number=lambda name: {"elasticity": 5.0}.get(name),
        number={"elasticity_combined": 0.5, "deepest": 1e-3}.get,
    )
    one = shared._mean_setup("sphere 1 mm", [row] * 4, ["elasticity", "viscosity"])
    assert one.values == {"elasticity": (5.0, 0.5)}  # a viscosity that needs a fact is not compared
    assert one.words == "sphere 1 mm, 1 mm deep, 4 curves"


def test_a_value_that_one_setup_lacks_has_no_score():
    table = pair_table([pair_of(1.5), pair_of(0.2, "viscosity")])
    assert [row[2:] for row in table.rows] == [("1.50", "-"), ("-", "0.20")]


def test_files_are_grouped_by_a_column_of_the_list_of_curves():
    cells = {"a.csv": {"specimen": "G1"}, "b.csv": {"day": "2"}}
    assert groups_of([], [], "specimen", cells) == {"a.csv": {"specimen": "G1"}}
    assert groups_of([], [], None, cells) == {}
