"""The open facts of a rig as a form: what is asked, what is refused, and what is fitted and taken back."""

import pytest
from palpate import ConfigurationError
from palpate_desk.action import Action
from palpate_desk.command_gate import demand_allowed
from palpate_desk.desk import Desk
from palpate_desk.fact_form import fact_mistakes, facts_message
from palpate_desk.folder_view import folder_message, row_messages
from palpate_engine import read_rig
from palpate_kit.curves.fit_folder import FitFolder

from tests.curves.conftest import NAMES, TIP
from tests.desk.conftest import opened, served

RIG = '# the blue stand\ninstrument = "a stand" # in room 3\n'


def test_facts_are_written_make_rows_stale_and_are_taken_back(desk, folder):
    rig, pipeline = folder / "fits" / "rig.toml", (folder / "fits" / "pipeline.toml").read_text()
    rig.write_text(RIG)
    desk.reload()
    action = desk.state_facts({"thickness": "8 mm", "poisson": "0.5 +- 0.01"})
    assert action.text == "palpate fit \"$out\" --thickness '8 mm' --poisson '0.5 +- 0.01' --no-refit"
    facts = read_rig(rig)
    assert (facts.thickness, facts.poisson) == ("8 mm", "0.5 +- 0.01")
    assert rig.read_text().startswith(RIG)
    assert (folder / "fits" / "pipeline.toml").read_text() == pipeline
    assert {row.state for row in desk.folder.rows} == {"stale"}
    desk.state_facts({"thickness": "9 mm"})
    desk.undo()
    assert read_rig(rig).thickness == "8 mm"
    desk.undo()
    assert rig.read_text() == RIG
    assert {row.state for row in desk.folder.rows} == {"current"}
    assert Action.of(action.text) == action


def test_every_mistake_is_beside_its_field():
    found = fact_mistakes({"thickness": "5 kPa", "delay": "1 ms", "poisson": "0.5", "measured": "x"})
    assert [*found] == ["thickness", "delay", "measured"]
    assert found["thickness"].startswith("'5 kPa'")
    assert "how certain" in found["delay"]


def test_facts_that_do_not_go_together_are_not_written(desk, folder):
    with pytest.raises(ConfigurationError, match="how stiff is the beam"):
        desk.state_facts({"position": "stage"})
    assert not (folder / "fits" / "rig.toml").exists()
    assert desk.latest is None


@pytest.mark.parametrize(
    "option",
    [
        ("--set", 'rig.tip="paraboloid 3 mm"'),
        ("--set", 'rig.columns={force = "x"}'),
        ("--set", "rig.measured={delay = 1}"),
        ("--set", "rig.thickness={file = 1}"),
        ("--unset", "rig.measured"),
        ("--unset", "run.plugins"),
        ("--thickness", "5 kPa"),
        ("--rig", "other.toml"),
    ],
)
def test_the_gate_lets_facts_pass_and_nothing_else_of_a_rig(option):
    demand_allowed(Action("fit", (("--set", 'rig.thickness="8 mm"'), ("--unset", "rig.delay"), ("--tare", "none"))))
    with pytest.raises(ConfigurationError):
        demand_allowed(Action("fit", (option,)))


@pytest.mark.slow
def test_what_the_form_states_is_fitted_as_if_it_had_been_stated_at_once(folder, palpate):
    done = palpate("fit", "curves", *TIP, "--thickness", "8 mm", "--poisson", "0.5 +- 0.01", "--out", "once")
    assert done.returncode == 0, done.stderr
    with (
        served(folder / "fits", "--workers", "1") as process,
        opened(process.address) as page,
        opened(process.address) as other,
    ):
        page.read("folder")
        other.read("folder")
        page.ask(do="facts")
        fields = {field["key"]: field for field in page.read("facts")["fields"]}
        assert {"thickness", "poisson"} <= {*fields}
        assert "delay" not in fields  # it is stated
        assert fields["thickness"]["question"] == "How thick is the specimen?"
        assert "lower" in fields["thickness"]["effect"]
        page.ask(do="state", answers={"thickness": "5 kPa", "poisson": "much"})
        assert {*page.read("mistakes")["mistakes"]} == {"thickness", "poisson"}
        page.ask(do="state", answers={"position": "stage"})
        assert "beam" in page.read("mistakes")["mistakes"][""]
        assert not (folder / "fits" / "rig.toml").exists()
        page.ask(do="state", answers={"thickness": "8 mm", "poisson": "0.5 +- 0.01"})
        assert {row["state"] for row in other.read("folder")["rows"]} == {"stale"}
        assert "--thickness '8 mm'" in other.read("done")["command"]
        assert page.read("mistakes")["mistakes"] == {}
        while other.read("rows", "state").get("done") != len(NAMES):
            pass
        page.ask(do="facts")
        left = [field["key"] for field in page.read("facts")["fields"]]
        assert not {"thickness", "poisson"} & {*left}
    stated, once = FitFolder(folder / "fits").rows, FitFolder(folder / "once").rows
    assert {row.state for row in stated} == {"current"}
    for row, other in zip(stated, once, strict=True):
        assert row.cells | {"settings": ""} == other.cells | {"settings": ""}
    done = palpate("report", "fits")
    assert done.returncode == 0, done.stderr
    assert "8 mm" in (folder / "fits" / "report.html").read_text()
    assert palpate("fit", "fits", "--unset", "rig.poisson", "--no-refit").returncode == 0
    assert {row.state for row in FitFolder(folder / "fits").rows} == {"stale"}
    assert palpate("fit", "fits", "--unset", "rig.poisson").returncode == 2


def test_a_fact_that_the_pipeline_states_goes_before_that_of_the_folder(folder, palpate):
    """An option of ``fit`` against the file of facts, which is copied beside the fits."""
    (folder / "fits" / "rig.toml").write_text('delay = "5 ms +- 1 ms"\n')
    assert {row.state for row in Desk(folder / "fits").folder.rows} == {"current"}


def test_a_fact_of_one_curve_is_shown_and_in_the_form_and_changed_for_it_alone(desk, folder):
    """A height for each curve was nowhere on the page, and the first column by which curves were grouped."""
    table = folder / "fits" / "curves.csv"
    head, *rows = table.read_text().splitlines()
    cells = [f"{row},{8 + number} mm,{'ab'[number % 2]}" for number, row in enumerate(rows)]
    table.write_text("\n".join([f"{head},thickness,group", *cells]) + "\n")
    desk.reload()
    first = next(row for row in row_messages(desk.folder, desk.folder.rows) if row["curve"] == NAMES[0])
    assert first["facts"] == {"thickness": "8 mm"}
    assert folder_message(desk)["group_by"] == "group"
    (field,) = facts_message(desk, [], NAMES[0])["stated"]
    assert (field["key"], field["value"], field["curve"]) == ("thickness", "8 mm", f"curve={NAMES[0]}")
    desk.set('rig.thickness="9 mm"', field["curve"])
    desk.reload()
    assert desk.folder.settings_of(NAMES[0])[-1] == 'rig.thickness="9 mm"'
    assert 'rig.thickness="9 mm"' not in desk.folder.settings_of(NAMES[1])


def test_no_file_of_facts_is_named_that_is_not_there(desk, folder):
    assert "rig.toml" not in facts_message(desk, [])["settled"]
    (folder / "fits" / "rig.toml").write_text(RIG)
    assert "rig.toml" in facts_message(desk, [])["settled"]


def test_each_value_of_a_row_has_its_verdict_and_the_residual_a_unit_with_digits(desk):
    message = folder_message(desk)
    assert message["residual_unit"] == "mN"
    for row in message["rows"]:
        assert row["verdicts"].keys() == message["units"].keys()
        assert set(row["verdicts"].values()) <= {"good", "doubtful", "not determined", "needs delay"}
        assert float(row["rms"]) > 1
