"""What stands below a table of fits: what the values hold for, what was found, what to type."""

from palpate_engine import registry
from palpate_fits.file_tables import count_line, verdict_lines

THICK, LEVEL = (
    "specimen thicker than 49 mm (22 mm: elasticity 11 % lower)",
    "the position is of the tip, and no command",
)


def lines(*cells, **more):
    rows = [{"curve": f"c{number}.csv", "conditions": cell, **more} for number, cell in enumerate(cells)]
    return list(verdict_lines(rows, registry.load()))


def test_each_open_fact_is_listed_once_with_its_effect_and_in_how_many_files_it_is_open():
    found = lines(f"thickness: {THICK}; position: {LEVEL}", f"thickness: {THICK.replace('11 %', '12 %')}")
    assert found == [f"holds if: {THICK}; {LEVEL} [1 of 2]"]


def test_what_a_value_needs_comes_with_the_words_that_state_it():
    (text,) = lines("", needs="delay")
    assert "alignment.force.uncertainty" in text


def test_a_row_whose_elasticity_is_refused_is_not_counted_as_usable():
    """The verdict of the track is the worst of the values with a number, and may be a better one."""
    good = {"curve": "a.csv", "verdict": "good", "elasticity_verdict": "good", "viscosity_verdict": "not-determined"}
    void = {"curve": "b.csv", "verdict": "doubtful", "elasticity_verdict": "invalid", "viscosity_verdict": "doubtful"}
    other = {"curve": "c.csv", "verdict": "good", "stiffness_verdict": "invalid", "damping_verdict": "good"}
    assert count_line([good], registry.load()) == "all 1 usable"
    assert count_line([good, void, other], registry.load()) == "1 usable, 2 not: no value (2)"


def test_files_without_conditions_or_findings_have_no_line():
    assert lines("", "") == []
