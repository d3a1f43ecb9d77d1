"""What stands below a table of fits: what the values hold for, what was found, what to type."""

from palpate_engine import registry
from palpate_fits.file_tables import verdict_lines

THICK, LEVEL = (
    "specimen thicker than 49 mm (22 mm: elasticity 11 % lower)",
    "the position is of the tip, and no command",
)


def lines(*cells, **more):
    rows = [{"curve": f"c{number}.csv", "conditions": cell, **more} for number, cell in enumerate(cells)]
    return list(verdict_lines(rows, registry.load(), "palpate fit curves"))


def test_each_open_fact_is_listed_once_with_its_effect_and_in_how_many_files_it_is_open():
    found = lines(f"thickness: {THICK}; position: {LEVEL}", f"thickness: {THICK.replace('11 %', '12 %')}")
    assert found == [
        f"holds if: {THICK}; {LEVEL} [1 of 2]",
        'state them, with your values: palpate fit curves --thickness "22 mm" --position-of tip',
    ]


def test_what_a_value_needs_comes_with_the_words_that_state_it():
    (text,) = lines("", needs="delay")
    assert text.endswith('palpate fit curves --delay "0 ms +- 1 ms"')


def test_files_without_conditions_or_findings_have_no_line():
    assert lines("", "") == []
