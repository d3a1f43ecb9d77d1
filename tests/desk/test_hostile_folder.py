"""A stranger's folder of fits: no file of it executes code, is approved, or is written to beside it."""

import asyncio
import csv
import json
import re
import shutil
import subprocess
from pathlib import Path

import pytest
from palpate import PalpateError, trust
from palpate_desk.curve_answers import curve_answer
from palpate_desk.desk import Desk, writing
from palpate_desk.folder_view import exported
from palpate_desk.page_messages import read_message

from tests.curves.conftest import NAMES
from tests.desk.conftest import opened, served

_PLUGIN = 'open({trace!r}, "w").close()\n'
_REVIEW = f'palpate repeat review "$out" --reject {NAMES[3]} --reason slipped'


@pytest.fixture
def evil(folder, tmp_path, monkeypatch):
    """A plugin file in the folder of fits; at the end nobody has executed or approved it."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    monkeypatch.setattr(trust, "_PROCESS", trust._Consent())
    monkeypatch.setattr(trust, "_consent", trust.ContextVar("_consent", default=trust._PROCESS))
    file = folder / "fits" / "evil.py"
    file.write_text(_PLUGIN.format(trace=str(tmp_path / "trace")))
    with trust.at_the_command_line(["desk", str(folder / "fits")]):
        yield file
    assert not (tmp_path / "trace").exists()
    assert not trust.trusted_plugins()


def setting(evil):
    return f"run.plugins={json.dumps([str(evil)])}"


def in_history(evil):
    rows = [
        (1, "2026-11-26T10:00:00.000+00:00", _REVIEW, f"palpate fit \"$out\" --set '{setting(evil)}' --no-refit", "")
    ]
    with (evil.parent / "history.csv").open("w", newline="") as file:
        csv.writer(file).writerows([("number", "time", "command", "inverse", "undoes"), *rows])


def in_pipeline(evil):
    pipeline = evil.parent / "pipeline.toml"
    pipeline.write_text(re.sub(r"^plugins = .*$", "", pipeline.read_text(), flags=re.M).replace(
        "[run]\n", f"[run]\nplugins = {json.dumps([str(evil)])}\n", 1))  # fmt: skip


def in_own(evil):
    (evil.parent / "own.toml").write_text(f'["{NAMES[0]}"]\nset = [{json.dumps(setting(evil))}]\n')


def as_option_of_own(evil):
    (evil.parent / "own.toml").write_text(f'["{NAMES[0]}"]\nset = ["--plugin={evil}"]\n')


def as_file_of_a_curve(evil):
    table = evil.parent / "curves.csv"
    table.write_text(re.sub(rf"^{NAMES[0]},[^,\n]*", f"{NAMES[0]},--plugin={evil}", table.read_text(), flags=re.M))


def as_column(evil):
    head, *rows = (evil.parent / "curves.csv").read_text().splitlines()
    text = "\n".join([f"{head},--plugin={evil}", *(f"{row},a" for row in rows)])
    (evil.parent / "curves.csv").write_text(text + "\n")


def as_name_of_a_curve(evil):
    for name in ("fits.csv", "curves.csv"):
        table = evil.parent / name
        table.write_text(re.sub(rf"^{NAMES[0]},", f"--plugin={evil},", table.read_text(), flags=re.M))


def in_rig(evil):
    (evil.parent / "rig.toml").write_text(f'thickness = "9 mm"\n[measured]\nplugins = [{json.dumps(str(evil))}]\n')


_WAYS = [in_rig, in_history, in_pipeline, in_own, as_option_of_own, as_file_of_a_curve, as_column, as_name_of_a_curve]


def _ask(desk, **message):
    return asyncio.run(exported(desk, read_message(json.dumps(message))))


def all_that_a_page_does(folder):
    """Everything that a page can ask for, one after the other; most of it is refused."""
    desk = Desk(folder)
    first, column = desk.folder.names[0], (desk.folder.columns or ["sample"])[-1]
    deeds = [
        desk.undo,
        lambda: desk.mark(first, "good", ""),
        lambda: desk.set("estimator.fit.solver=trf", None),
        lambda: desk.set("estimator.fit.segment=load", None),
        lambda: desk.set("estimator.fit.segment=load", f"curve='{first}'"),
        lambda: desk.set_part("tip", "paraboloid 4 mm"),
        lambda: desk.set_part("model", "hunt-crossley"),
        lambda: desk.state_facts({"thickness": "8 mm"}),
        *[desk.undo] * 7,
        lambda: curve_answer(desk.reader(first), desk.curve(first), True),
        lambda: _ask(desk, do="groups", by=column, parameter="elasticity"),
        lambda: _ask(desk, do="compare", curve=first, model="hunt-crossley"),
        lambda: _ask(desk, do="export", what="report", by=column),
        lambda: _ask(desk, do="export", what="groups", by=column, parameter="elasticity"),
        lambda: _ask(desk, do="export", what="figure", curve=first),
        lambda: _ask(desk, do="export", what="history"),
    ]
    told = []
    for deed in deeds:
        try:
            deed()
        except PalpateError as error:
            told.append(str(error))
    return told


@pytest.mark.slow
@pytest.mark.parametrize("way", _WAYS)
def test_nothing_that_a_page_does_executes_a_file_of_the_folder(evil, way, tmp_path):
    way(evil)
    all_that_a_page_does(evil.parent)
    script = evil.parent / "history.sh"
    if script.exists():  # and none of its words is an option of its own for a shell
        text = f'palpate() {{ printf "%s\\n" "$@"; }}\n{script.read_text()}'
        words = subprocess.check_output(["sh", "-c", text, "sh", str(evil.parent)], text=True).splitlines()
        assert "repeat" in words
        assert not [word for word in words if word.startswith("--plugin")]


def test_undo_takes_back_nothing_that_the_page_has_not_done(evil):
    in_history(evil)
    with pytest.raises(PalpateError, match="nothing to undo"):
        Desk(evil.parent).undo()


@pytest.mark.slow
@pytest.mark.parametrize("way", [in_own, as_option_of_own, in_pipeline])
@pytest.mark.parametrize(
    "command",
    [
        ("fit", "fits"),
        ("fit", "fits", "--set", "estimator.fit.segment=load"),
        ("fit", "fits", "--where", "S1", "--set", "estimator.fit.segment=load"),
        ("fit choose", "fits", "--models", "dr,hunt-crossley"),
        ("repeat", "fits"),
        ("report", "fits"),
        ("report", "fits", "--by", "sample"),
        ("desk", "fits", "--groups", "groups.csv", "--history"),
    ],
)
def test_no_command_on_the_folder_does(evil, way, command, palpate):
    way(evil)
    name, *words = command
    palpate(*name.split(), *words)


@pytest.mark.parametrize(
    "command",
    [
        """palpate fit "$out" --set 'run.plugins=["evil.py"]' --no-refit""",
        'palpate fit "$out" --plugin evil.py',
        'palpate fit "$out" --plugin=evil.py',
        'palpate fit "$out"; touch trace',
        'palpate fit "$out" && touch trace',
        'palpate fit "$out" --where $(touch trace)',
        "palpate run /stranger/evil.toml",
        'palpate fit /stranger --pipeline /stranger/evil.toml --each --no-refit --out "$out"',
        'palpate fit c.csv --pipeline "$out"/pipeline.toml --out "$out"/figures/c',
        'palpate fit c.csv --each --pipeline "$out"/pipeline.toml --no-refit --out "$out"',
        'palpate fit c.csv --tip "paraboloid 3 mm" --pipeline "$out"/pipeline.toml --no-refit --out "$out"',
        'palpate fit /stranger/evil.toml --each --no-refit --out "$out"',
        'palpate report "$out" --by sample',
        "touch trace",
        "\ntouch trace",
        "x\ntouch trace\n",
        "x\r\ntouch trace",
        "",
        'palpate fit "$out" --set "',
        r"""palpate fit "$out" --set 'indenter.tip."po\u0069nts"=/etc/passwd'""",
        r"""palpate fit "$out" --set 'indenter.tip={type="profile", "po\u0069nts"="/etc/passwd"}'""",
    ],
)
def test_a_script_has_commands_of_the_page_only(evil, command, palpate, tmp_path):
    """Whatever else a history says is a comment, which no line ends."""
    with (evil.parent / "history.csv").open("w", newline="") as file:
        csv.writer(file).writerows([("number", "time", "command"), (1, "", command), (2, "", _REVIEW)])
    done = palpate("desk", "fits", "--history")
    assert done.returncode == 0, done.stderr
    lines = done.stdout.splitlines()
    assert [line for line in lines if not line.startswith("#")] == ["set -e", "out=${1:?which folder}", _REVIEW]
    script = 'palpate() { printf "%s\\n" "$@" >> said; }\n' + done.stdout
    subprocess.run(["sh", "-c", script, "sh", str(evil.parent)], check=True, cwd=tmp_path)
    assert not (tmp_path / "trace").exists()


def test_the_name_of_a_folder_stays_in_its_comment(folder, palpate, tmp_path):
    odd = tmp_path / "fits\ntouch trace"
    shutil.copytree(folder / "fits", odd)
    Desk(odd).mark("curves/S1_0.csv", "good", "")
    script = "palpate() { :; }\n" + palpate("desk", odd, "--history").stdout
    subprocess.run(["sh", "-c", script, "sh", "x"], check=True, cwd=tmp_path)
    assert not (tmp_path / "trace").exists()


@pytest.mark.parametrize(
    "text",
    [
        "number,time,command\nx,y\n",
        "number,time,command,inverse,undoes\nnone,,,,seven\n,,,,,,,,\n",
        "number,time,command\n1,2,3,4,5,6\n",
    ],
)
def test_odd_rows_of_the_history_are_left_where_they_are(folder, text):
    path = folder / "fits" / "history.csv"
    path.write_text(text)
    desk = Desk(folder / "fits")
    desk.mark(NAMES[0], "good", "")
    desk.undo()
    assert path.read_text().startswith(text)
    assert len(path.read_text().splitlines()) == len(text.splitlines()) + 2
    assert "--accept" in desk.history.script


@pytest.mark.parametrize("content", [b"a,b\n1,2\n", b"\xff\xfe\n", b"[" * 200_000 + b"\n"])
def test_what_is_no_history_is_told_before_anything_is_done(folder, content):
    path = folder / "fits" / "history.csv"
    path.write_bytes(content)
    desk = Desk(folder / "fits")
    with pytest.raises(PalpateError, match=r"history\.csv"):
        desk.mark(NAMES[0], "good", "")
    assert not Desk(folder / "fits").folder.marks.accepted
    assert path.read_bytes() == content


@pytest.mark.parametrize("name", [".desk.lock", "history.csv", "fits.csv", "groups.svg", "figures", "report.html"])
def test_what_is_written_does_not_leave_the_folder_by_a_link(folder, tmp_path, name):
    fits, outside = folder / "fits", tmp_path / "outside"
    if name == "fits.csv":
        shutil.copy(fits / name, outside)
        (fits / name).unlink()
    elif name == "figures":
        outside.mkdir()
    elif name != "history.csv":
        outside.write_text("the user's\n")
    (fits / name).symlink_to(outside)
    before = outside.read_bytes() if outside.is_file() else None

    def write():
        desk = Desk(fits)
        rows = [row.cells for row in desk.folder.rows_of(NAMES[0])]
        with writing(fits):
            desk.mark(NAMES[0], "good", "")
            desk.take_rows(rows)
            _ask(desk, do="export", what="figure" if name == "figures" else "groups", by="sample", curve=NAMES[0])

    with pytest.raises(PalpateError, match=f"{re.escape(name)}: (cannot write: )?is a link"):
        write()
    assert (outside.read_bytes() if outside.is_file() else None) == before
    assert not outside.is_dir() or not list(outside.iterdir())


@pytest.mark.parametrize("place", ["/dev/zero", "../lab.toml", "./pipeline.toml"])
def test_a_curve_is_read_by_a_dialect_of_the_folder(folder, place):
    table = folder / "fits" / "curves.csv"
    head, first, *rest = table.read_text().splitlines()
    assert head == "curve,file,dialect"
    table.write_text("\n".join([head, first.removesuffix(",") + f",{place}", *rest]))
    with pytest.raises(PalpateError, match=r"no dialect"):
        Desk(folder / "fits")


@pytest.mark.slow
def test_a_folder_that_vanishes_is_a_message_and_not_the_end_of_the_connection(folder):
    fits, aside = folder / "fits", folder / "aside"
    (fits / "history.csv").write_text("number,time,command\nx\n")
    with served(fits) as process, opened(process.address) as page:
        page.read("folder")
        fits.rename(aside)
        page.ask(do="mark", curve=NAMES[0], mark="good")
        assert page.read("error")["text"]
        for message in (
            {"do": "curve", "curve": NAMES[1], "number": 1},
            {"do": "undo"},
            {"do": "export", "what": "history"},
            {"do": "tip", "value": "paraboloid 4 mm"},
            {"do": "refit-all"},
        ):
            page.ask(**message)
            assert page.read("error")["text"]
        with opened(process.address) as other:
            assert other.read("error")["text"]
            aside.rename(fits)
            assert len(other.read("folder")["rows"]) == 8
        page.ask(do="mark", curve=NAMES[0], mark="good")
        assert page.read("rows")["rows"][0]["mark"] == "good"


@pytest.mark.slow
def test_a_plugin_file_that_a_person_has_named_goes_along_with_the_folder(folder, tmp_path, monkeypatch, palpate):
    """It is the content that was approved: the folder works, also on the page, until the file is another one."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    monkeypatch.setattr(trust, "_PROCESS", trust._Consent())
    monkeypatch.setattr(trust, "_consent", trust.ContextVar("_consent", default=trust._PROCESS))
    own = tmp_path / "lab.py"
    own.write_text(_PLUGIN.format(trace=str(tmp_path / "trace")) + "from palpate import plugin\n@plugin\n"
                   "def palpate_models():\n    return {}\n")  # fmt: skip
    text = (folder / "fits" / "pipeline.toml").read_text()
    text = text.replace('"../curves/', '"curves/')  # it lies beside them
    text = re.sub(r"^plugins = .*$", "", text, flags=re.M).replace("[run]\n", '[run]\nplugins = ["lab.py"]\n', 1)
    (tmp_path / "lab.toml").write_text(text)
    done = palpate("fit", "curves", "--each", "--pipeline", "lab.toml", "--out", "mine", "--jobs", "2")
    assert done.returncode == 0, done.stderr
    done = palpate("fit", "mine", "--set", "estimator.fit.segment=load", "--no-refit")
    assert done.returncode == 0, done.stderr
    done = palpate("fit", "mine")
    assert done.returncode == 0, done.stderr
    with trust.at_the_command_line(["desk", "mine"]):
        told = all_that_a_page_does(Path("mine"))
    assert not [text for text in told if "lab.py" in text]
    own.write_text(own.read_text() + "# changed\n")
    (tmp_path / "trace").unlink()
    done = palpate("fit", "mine", "--set", "estimator.fit.segment=unload")
    assert done.returncode == 2
    assert "palpate trust " in done.stderr
    with trust.at_the_command_line(["desk", "mine"]):
        assert [text for text in all_that_a_page_does(Path("mine")) if "palpate trust " in text]
    assert not (tmp_path / "trace").exists()
