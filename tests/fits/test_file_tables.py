"""What stands below a table of fits: what the values hold for, what was found, what to type."""

from dataclasses import replace

import palpate_engine as engine
from palpate_engine import registry
from palpate_fits.file_tables import count_line, show_rows, verdict_lines
from palpate_kit.curves.curve_fits import offline

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


def test_a_row_whose_elasticity_is_refused_is_not_counted_as_usable():
    """The verdict of the track is the worst of the values with a number, and may be a better one."""
    good = {"curve": "a.csv", "verdict": "good", "elasticity_verdict": "good", "viscosity_verdict": "not-determined"}
    void = {"curve": "b.csv", "verdict": "doubtful", "elasticity_verdict": "invalid", "viscosity_verdict": "doubtful"}
    other = {"curve": "c.csv", "verdict": "good", "stiffness_verdict": "invalid", "damping_verdict": "good"}
    assert count_line([good], registry.load()) == "all 1 usable"
    assert count_line([good, void, other], registry.load()) == "1 usable, 2 not: no value (2)"


def test_files_without_conditions_or_findings_have_no_line():
    assert lines("", "") == []


def test_a_long_table_is_forty_rows_and_a_summary_and_all_of_them_on_request(root, capsys):
    pipeline = offline(engine.load_pipeline(root / "pipelines" / "point.toml", ["estimator.fit.type=casadi-fit"]))
    pipeline = replace(pipeline, tracks=pipeline.tracks[:1])
    name = str(pipeline.tracks[0].name)
    rows = [
        {"curve": f"c{k:02d}.csv", "track": name, "elasticity": f"{1e5 + 1e3 * k}", "elasticity_combined": "2e3",
         "surface": "0", "verdict": "good" if k else "doubtful"}
        for k in range(63)
    ]  # fmt: skip
    show_rows(rows, pipeline, registry.load(), "palpate fit curves")
    said = capsys.readouterr().out
    assert said.count(".csv ") == 40
    assert "and 23 more: --details shows all" in said
    assert "131 (115.5 to 146.5)" in said  # the median of all
    show_rows(rows, pipeline, registry.load(), "palpate fit curves", details=True)
    assert capsys.readouterr().out.count(".csv ") == 63
