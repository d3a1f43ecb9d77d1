"""Which column of ``curves.csv`` names the units of replication."""

import pytest
from palpate import ConfigurationError
from palpate_kit.curves.replication_unit import replication_unit, unit_of


def cells(**columns):
    """Cells of curves, from the values of each column with blanks between."""
    split = {name: text.split() for name, text in columns.items()}
    return [dict(zip(split, row)) for row in zip(*split.values(), strict=True)]


ANIMALS = {"control": cells(animal="1 1 2 2", site="a b a b"), "drug": cells(animal="3 3 4 4", site="a b a b")}


def test_values_that_lie_in_one_group_each_are_units():
    assert replication_unit(ANIMALS) == "animal"


def test_one_group_has_single_curves():
    assert replication_unit({"curves": ANIMALS["control"]}) == "curve"


@pytest.mark.parametrize("animals", ["3 3 3 3", "1 1 2 2", "1 1 3 3"])
def test_a_column_of_too_few_values_or_of_several_groups_is_no_unit(animals):
    assert replication_unit({**ANIMALS, "drug": cells(animal=animals, site="a b a b")}) == "curve"


def test_places_and_facts_are_no_units():
    groups = {name: cells(x_m=x, thickness="1 2") for name, x in (("a", "1 2"), ("b", "3 4"))}
    groups["b"][0]["thickness"], groups["b"][1]["thickness"] = "3", "4"
    assert replication_unit(groups) == "curve"


def test_of_two_columns_one_within_the_other_the_coarser_is_the_unit():
    groups = {
        "control": cells(organ="1l 1r 2l 2r", animal="1 1 2 2"),
        "drug": cells(organ="3l 3r 4l 4r", animal="3 3 4 4"),
    }
    assert replication_unit(groups) == "animal"


def test_of_two_columns_that_cross_neither_is_chosen():
    groups = {
        "control": cells(animal="1 1 2 2", day="mo tu mo tu"),
        "drug": cells(animal="3 3 4 4", day="we th we th"),
    }
    with pytest.raises(ConfigurationError, match="--unit animal or --unit day"):
        replication_unit(groups)
    assert replication_unit(groups, "day") == "day"
    assert replication_unit(groups, "curve") == "curve"


def test_a_unit_that_is_no_column_is_refused():
    with pytest.raises(ConfigurationError, match=r"--unit anmal: .*did you mean 'animal'"):
        replication_unit(ANIMALS, "anmal")


def test_a_unit_of_several_groups_is_refused():
    with pytest.raises(ConfigurationError, match="--unit site: a lies in several groups"):
        replication_unit(ANIMALS, "site")


def test_a_curve_without_its_unit_is_named():
    with pytest.raises(ConfigurationError, match=r"S1_07: curves.csv does not say of which animal"):
        unit_of("S1_07", {"animal": ""}, "animal")
    assert unit_of("S1_07", {"animal": ""}, "curve") == "S1_07"
