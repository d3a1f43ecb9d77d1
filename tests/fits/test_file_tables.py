"""The screen of a table of fits: a verdict next to its value, findings once for all files, how many have which word."""

from dataclasses import replace

import palpate_engine as engine
import pytest
from palpate import Flag
from palpate_engine import registry
from palpate_fits.file_tables import partition_line, show_rows
from palpate_kit.curves.curve_fits import offline
from palpate_kit.curves.row_results import row_table
from palpate_kit.terminal.result_screen import LEGEND, WIDTH, command_stating, fact_lines, finding_lines, title_line
from palpate_kit.terminal.result_table import ResultFinding

THICK = "specimen thicker than 49 mm: 22 mm makes elasticity 11 % lower"
LEVEL = "the position is of the tip, and no command"
SIGN = "the force grows faster with depth than on a half-space; thickness would explain 96 % of it"
LAYER = f"lack-of-fit[thickness, another tip] elasticity 0.3: {SIGN} -> --thickness VALUE"


@pytest.fixture(scope="module")
def pipeline(root):
    found = offline(engine.load_pipeline(root / "pipelines" / "point.toml", ["estimator.fit.type=casadi-fit"]))
    return replace(found, tracks=found.tracks[:1])


def row(number, **cells):
    words = {"elasticity_verdict": "good", "viscosity_verdict": "not determined"}
    return {"curve": f"c{number:02d}.csv", "track": "dr/fit", "elasticity": "1e5", "elasticity_combined": "2e3",
            "viscosity": "40", "viscosity_combined": "50", **words, **cells}  # fmt: skip


def table_of(rows, pipeline):
    return row_table(rows, pipeline.tracks[0].model, registry.load())


def test_each_open_fact_is_listed_once_with_its_effect_and_in_how_many_files_it_is_open(pipeline):
    rows = [row(0, conditions=f"thickness: {THICK}; position: {LEVEL}"),
            row(1, conditions=f"thickness: {THICK.replace('11 %', '12 %')}")]  # fmt: skip
    assert list(fact_lines(table_of(rows, pipeline))) == [
        "Not in the ±, since nobody stated it:",
        "  E       specimen thicker than 49 mm: 22 mm makes E 11 % lower",
        "          state: --thickness VALUE",
        "  E, eta  the position is of the tip, and no command [1 of 2 files]",
        "          state: --position-of VALUE",
    ]
    assert list(fact_lines(table_of(rows, pipeline), "palpate fit fits"))[-1] == (
        "  state: palpate fit fits --thickness VALUE --position-of VALUE"
    )
    assert list(fact_lines(table_of([row(0)], pipeline))) == []


def test_files_that_share_a_finding_are_one_with_the_largest_effect(pipeline):
    rows = [row(0, elasticity_verdict="doubtful", findings=LAYER), row(1),
            row(2, elasticity_verdict="doubtful", findings=LAYER.replace("0.3", "0.47"))]  # fmt: skip
    advice = {"--thickness": ["or a column `thickness` in curves/curves.csv, a value for each file"]}
    assert list(finding_lines(table_of(rows, pipeline), "palpate fit fits", advice)) == [
        "doubtful[lack-of-fit: thickness] E, 2 of 3 files: the force grows faster with",
        "  depth than on a half-space; it can move E by up to 47 %",
        "  help: state it: palpate fit fits --thickness VALUE",
        "        or a column `thickness` in curves/curves.csv, a value for each file",
    ]


def test_a_finding_is_of_the_values_that_have_its_word_and_of_no_other(pipeline):
    """A viscosity that is not determined is not "doubtful" as well, and a good elasticity is not doubted below it."""
    both = LAYER.replace("elasticity 0.3", "elasticity 0.3, viscosity 1.2")
    doubted = table_of([row(0, elasticity_verdict="doubtful", findings=both)], pipeline)
    ((finding, _, names),) = doubted.shared_findings()
    assert (names, dict(finding.sizes)) == (["elasticity"], {"elasticity": 0.3})
    assert table_of([row(0, findings=both)], pipeline).shared_findings() == []


def test_a_finding_is_the_same_in_a_cell_and_out_of_it():
    own = {"remedy": "--thickness VALUE", "suspects": ("thickness",), "moves": ("elasticity",)}
    flag = Flag("lack-of-fit", SIGN, "doubtful", {"elasticity": 3e4}, **own)
    finding = ResultFinding.of_flag(flag, {"elasticity": 1e5, "viscosity": 40.0})
    assert finding.cell == LAYER.replace("thickness, another tip", "thickness")
    severities = {"lack-of-fit": "doubtful"}
    assert list(ResultFinding.of_cell(" | ".join([finding.cell] * 2), severities)) == [finding, finding]
    assert Flag.of_table(flag.table()) == flag
    assert Flag.of_table(flag.table()).moves == ("elasticity",)


def test_the_last_line_partitions_the_files_for_each_value(pipeline):
    rows = [row(0), row(1, elasticity_verdict="doubtful"), row(2, elasticity_verdict="needs thickness"),
            {"curve": "c3.csv", "error": "the file is empty"}]  # fmt: skip
    assert partition_line(rows, pipeline, registry.load()) == (
        "4 files. E: 1 good, 1 doubtful, 1 needs a thickness; eta: 3 not determined; 1\n  not read"
    )
    rows = [row(k, viscosity_verdict="needs delay") for k in range(2)]
    assert partition_line(rows, pipeline, registry.load()) == "2 files. E: 2 good, 0 doubtful; eta: 2 need a delay"


def test_a_verdict_is_next_to_its_value_and_a_screen_is_no_wider_than_79(pipeline, capsys):
    rows = [row(0), row(1, elasticity_verdict="doubtful", findings=LAYER)]
    show_rows(rows, pipeline, registry.load(), "palpate fit fits")
    lines = capsys.readouterr().out.splitlines()
    cells = [line.split() for line in lines]
    assert ["c00.csv", "100.0", "±", "2.0", "good", "40", "±", "50", "not", "determined"] in cells
    assert ["c01.csv", "100.0", "±", "2.0", "doubtful", "40", "±", "50", "not", "determined"] in cells
    assert max(map(len, lines)) <= WIDTH
    assert len(title_line("a" * 90)) == len(title_line("one")) == WIDTH
    assert title_line("one").endswith(LEGEND)


def test_one_file_is_a_line_for_each_value(pipeline, capsys):
    show_rows([row(0)], pipeline, registry.load(), "palpate fit fits")
    assert capsys.readouterr().out.splitlines() == [
        "  E    100.0 ± 2.0 kPa    good",
        "  eta     40 ± 50  Pa s   not determined",
    ]


def test_a_long_table_is_forty_rows_and_a_summary_and_all_of_them_on_request(pipeline, capsys):
    name = str(pipeline.tracks[0].name)
    rows = [row(k, track=name, elasticity=f"{1e5 + 1e3 * k}", surface="0", verdict="good") for k in range(63)]
    show_rows(rows, pipeline, registry.load(), "palpate fit curves")
    said = capsys.readouterr().out
    assert said.count(".csv ") == 40
    assert "and 23 more: --details shows all" in said
    assert "131 (115.5 to 146.5)" in said  # the median of all
    show_rows(rows, pipeline, registry.load(), "palpate fit curves", details=True)
    assert capsys.readouterr().out.count(".csv ") == 63


@pytest.mark.parametrize(
    ("command", "facts", "line"),
    [
        ("palpate fit a.csv", ["--tip VALUE"], "palpate fit a.csv --tip VALUE"),
        (
            "palpate fit a.csv --tip 'sphere 5 mm' --base bonded",
            ["--tip VALUE"],
            "palpate fit a.csv --base bonded --tip VALUE",
        ),
        (
            "palpate replay 'my run'",
            ["--delay VALUE", "--poisson VALUE"],
            "palpate replay 'my run' --delay VALUE --poisson VALUE",
        ),
    ],
)
def test_a_fact_is_stated_once_in_a_command(command, facts, line):
    assert command_stating(command, facts) == line
