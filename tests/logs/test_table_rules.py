"""Rules of tables: each says what it looks at and decides, and the surest that applies decides."""

import numpy as np
import pytest
from palpate_logs.csv_roles import read_sheet
from palpate_logs.role_rules import CLAIM_RULES, EXCLUSION_RULES, column_roles
from palpate_logs.suggestion_rules import SUGGESTION_RULES
from palpate_records.tables.csv_clock import TIME_RULES
from palpate_records.tables.heading_rules import NAME_RULES, UNIT_RULES, are_units
from palpate_records.tables.rules import Sureness, decision, rule
from palpate_reference.table_blocks import FORMAT_RULES

LISTS = (NAME_RULES, UNIT_RULES, TIME_RULES, CLAIM_RULES, EXCLUSION_RULES, SUGGESTION_RULES, FORMAT_RULES)


def of(sureness, answer):
    return rule("a number", "a word", sureness)(lambda number: answer if number > 0 else None)


@pytest.mark.parametrize("rules", LISTS)
def test_a_rule_says_what_it_looks_at_and_decides(rules):
    assert all(len(one.looks_at) > 5 and len(one.decides) > 5 and one.decide.__doc__ for one in rules)
    assert len({one.name for one in rules}) == len(rules)


def test_the_surest_rule_decides_whatever_the_order():
    rules = [of(Sureness.GUESS, "guess"), of(Sureness.STATED, "stated"), of(Sureness.STATED, "second")]
    assert decision(rules, 1) == "stated"
    assert decision(rules[::-1], 1) == "second"
    assert decision(rules, -1) is None


@pytest.mark.parametrize(
    ("head", "roles"),
    [
        ("t,Load (N),Kraft,z", ["time", "force", None, "position"]),  # a unit is surer than a word
        ("t,Kraft,Weg,F", ["time", None, "position", "force"]),  # a whole name is surer than a word
        ("t,Load (mm),Fz,Weg", ["time", "other", "force", "position"]),
        ("t,d_mean,Kraft,Temperatur", ["time", "position", "force", "other"]),
    ],
)
def test_a_role_goes_to_the_columns_that_have_it_most_surely(tmp_path, head, roles):
    path = tmp_path / "press.csv"
    np.savetxt(path, np.random.default_rng(0).normal(size=(60, 4)), "%.4f", ",", header=head, comments="")
    looked = read_sheet(path, {})
    assert column_roles(looked.sheet, looked.values) == roles


@pytest.mark.parametrize(
    ("cells", "answer"),
    [
        (["s", "mm", "N"], True),
        (["Hz", "Pa", "Pa", "1"], True),
        (["rad/s", "Pa", "", "°C"], True),
        (["%", "C"], False),
        (["s", "height"], False),
        (["", ""], False),
    ],
)
def test_a_row_of_units_holds_nothing_else_and_one_that_is_certain(cells, answer):
    assert are_units(cells) is answer
