"""Terminals of every kind: narrow, dumb, without colours, locale or reader; and Ctrl-C at once."""

import contextlib
import os
import signal
import subprocess
import sys
import time
from typing import Annotated

import casadi as ca
import numpy as np
import pytest
from palpate_engine.cli import import_interrupts
from palpate_engine.cli.import_interrupts import deferred_interrupts
from palpate_kit.terminal.quantities import value_with_uncertainty
from palpate_kit.terminal.table import Table as Cells, console
from pydantic import BeforeValidator, TypeAdapter
from rich.table import Table

from tests.processes import PIPE, start

COMMAND = [sys.executable, "-c", "from palpate_engine.cli import main; main()"]


def run(*arguments, **env):
    given = {key: value for key, value in os.environ.items() if key not in ("LANG", "LC_ALL", "LC_CTYPE", "COLUMNS")}
    return subprocess.run([*COMMAND, *map(str, arguments)], env={**given, **env}, capture_output=True, timeout=120)


@pytest.mark.slow
@pytest.mark.parametrize(
    "env",
    [
        {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"},
        *(
            pytest.param(env, marks=pytest.mark.slow)
            for env in (
                {"LC_ALL": "POSIX", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"},
                {"PYTHONIOENCODING": "ascii"},
                {"TERM": "dumb", "NO_COLOR": "1", "COLUMNS": "20"},
                {"TERM": "", "COLUMNS": "0"},
            )
        ),
    ],
    ids=["C", "POSIX", "ascii", "dumb", "no-terminal"],
)
def test_every_terminal_gets_its_table(root, env):
    done = run("check", "motion", root / "pipelines" / "point_ur3e.toml", **env)
    assert done.returncode == 0, done.stderr
    text = done.stdout.decode(env.get("PYTHONIOENCODING", "utf-8"))
    assert "z             -5 to 5 mm (limits -7 to 20)" in text
    assert b"\x1b" not in done.stdout
    assert b"Traceback" not in done.stderr
    if "ascii" in env.values():
        assert text.isascii()
        assert "\\" not in text


@pytest.mark.parametrize(
    "arguments",
    [
        ("--help",),
        *(
            pytest.param(words, marks=pytest.mark.slow)
            for words in (["list"], ["describe", "ekf"], ["describe", "schema"])
        ),
    ],
)
def test_a_reader_that_goes_early_is_no_error(arguments):
    """As `| head -1` does: the pipe is closed before anything was written, or in the middle."""
    process = subprocess.Popen([*COMMAND, *arguments], stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    process.stdout.close()
    _, errors = process.communicate(timeout=120)
    assert errors == b""


@pytest.mark.parametrize("wait", [0.0, *(pytest.param(wait, marks=pytest.mark.slow) for wait in (0.1, 0.3, 0.6, 0.9))])
def test_ctrl_c_within_the_first_second_ends_without_a_traceback(point_pipeline, tmp_path, wait):
    """Counted from where the interpreter has come to the command: before that it is the interpreter's own affair."""
    code = "import sys\nfrom palpate_engine.cli import main\nprint('ready', flush=True)\nmain(sys.argv[1:])"
    words = ["run", point_pipeline, "--out", tmp_path / "out", "--set", "device.rig.pace=real-time"]
    process = start(code, *words, stdout=PIPE, stderr=PIPE, text=True)
    try:
        assert process.stdout.readline() == "ready\n"
        time.sleep(wait + 0.002)
        process.send_signal(signal.SIGINT)
        _, errors = process.communicate(timeout=120)
    finally:
        process.kill()
    assert process.returncode == 130, errors
    assert "Traceback" not in errors


def test_ctrl_c_while_pydantic_makes_a_class_is_ctrl_c(palpate, point_pipeline, tmp_path):
    """It makes an error of its own of it, which was once told as a part that cannot be imported."""
    (tmp_path / "own.py").write_text(
        "from pydantic_core import SchemaValidator, core_schema\n"
        "class Pressed:\n    def __repr__(self):\n        raise KeyboardInterrupt\n"
        "SchemaValidator(core_schema.nullable_schema(core_schema.literal_schema([Pressed()])))\n"
    )
    done = palpate("check", point_pipeline, "--plugin", "own.py")
    assert done.returncode == 130, done.stderr
    assert done.stderr.endswith("palpate: stopped\n")
    assert "SchemaError" not in done.stderr


@pytest.mark.parametrize("presses", [1, 5])
def test_ctrl_c_during_an_import_is_not_lost(palpate, point_pipeline, tmp_path, monkeypatch, presses):
    """Whatever an import makes of an exception: the press waits until it is over, and the import is whole."""
    (tmp_path / "modules").mkdir()
    monkeypatch.syspath_prepend(tmp_path / "modules")
    (tmp_path / "own.py").write_text(f"import swallows_{presses}\n")
    (tmp_path / "modules" / f"swallows_{presses}.py").write_text(
        "import signal\nfrom pathlib import Path\n"
        f"try:\n    for _ in range({presses}):\n        signal.raise_signal(signal.SIGINT)\n"
        "except BaseException:\n    pass\n"
        "Path('whole').touch()\n"
    )
    done = palpate("check", point_pipeline, "--plugin", "own.py")
    assert done.returncode == 130, done.stdout
    assert "Traceback" not in done.stderr
    assert (tmp_path / "whole").exists()


def wait_for_the_press():
    """Longer than a press that waits takes to be raised."""
    deadline = time.monotonic() + 60.0
    while time.monotonic() < deadline:
        time.sleep(0.01)


def press():
    signal.raise_signal(signal.SIGINT)


class PressDuringDeletion:
    def __del__(self):
        press()


def swallow_in_pydantic(steps):
    """Its compiled core drops exceptions of what it calls, or makes others of them."""

    def validate(value):
        press()
        steps.append("whole")
        return value

    TypeAdapter(Annotated[int, BeforeValidator(validate)]).validate_python(1)


def swallow_in_casadi(steps):
    """Of presses while it makes expressions it dropped two of five."""

    class Pressing:
        def __SX__(self):  # noqa: N802
            press()
            steps[:] = ["whole"]
            return ca.SX(1.0)

    assert ca.SX.sym("x") + Pressing() is not None


def swallow_in_destructor(steps):
    steps.append(PressDuringDeletion())
    steps.clear()
    steps.append("whole")


def swallow_in_long_import(steps):
    """The exception that ends an import which takes too long is swallowed by that."""
    code = "def take_long():\n    try:\n        wait()\n    except BaseException:\n        steps.append('whole')\n"
    names = {"wait": lambda: (press(), wait_for_the_press()), "steps": steps}
    exec(compile(code, "<frozen importlib._bootstrap>", "exec"), names)
    names["take_long"]()


@pytest.mark.parametrize(
    "swallow", [swallow_in_pydantic, swallow_in_casadi, swallow_in_destructor, swallow_in_long_import]
)
def test_ctrl_c_that_is_swallowed_is_raised_afterwards(swallow, monkeypatch):
    """Of some hundred runs that were stopped while they were loaded two went on to their ends."""
    monkeypatch.setattr(import_interrupts, "_LONGEST", 0.05)
    steps = []

    def go_on():
        swallow(steps)
        wait_for_the_press()

    with without_handlers(), pytest.raises(KeyboardInterrupt):
        interruptibly(go_on)
    assert steps == ["whole"]
    assert signal.getsignal(signal.SIGALRM) is signal.SIG_DFL


def test_ctrl_c_that_ends_a_long_import_is_raised_once(monkeypatch):
    """Whatever is put in order on the way out is not ended as well."""
    monkeypatch.setattr(import_interrupts, "_LONGEST", 0.05)
    order = []
    code = "def take_long():\n    wait()\n"
    names = {"wait": lambda: (press(), wait_for_the_press())}
    exec(compile(code, "<frozen importlib._bootstrap>", "exec"), names)

    def put_in_order():
        try:
            names["take_long"]()
        finally:
            time.sleep(0.3)
            order.append("whole")

    with without_handlers(), pytest.raises(KeyboardInterrupt):
        interruptibly(put_in_order)
    assert order == ["whole"]


def interruptibly(function):
    """Call a function as the command line does."""
    with deferred_interrupts():
        function()


@contextlib.contextmanager
def without_handlers():
    """The handlers and the hook of a process that begins, within the context."""
    before, hook = signal.signal(signal.SIGINT, signal.default_int_handler), sys.unraisablehook
    sys.unraisablehook = sys.__unraisablehook__
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
        sys.unraisablehook = hook


def test_a_table_too_wide_is_printed_row_by_row(capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "30")
    table = Table(title="results")
    for heading in ("track", "elasticity\nkPa", "viscosity\nPa*s"):
        table.add_column(heading)
    table.add_row("dimensionality-reduction/kinematic", "112.43 ± 0.21", "361.2 ± 3.4")
    console(30).print(table)
    text = capsys.readouterr().out
    assert "…" not in text
    whole = "".join(text.split())
    for words in ("track:dimensionality-reduction/kinematic", "elasticitykPa:112.43±0.21", "viscosityPa*s:361.2±3.4"):
        assert words in whole
    console(120).print(table)
    assert "┃" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("value", "std", "text"),
    [(-0.0, 0.1, "0.00 ± 0.10"), (-0.001, 0.5, "0.00 ± 0.50"), (-0.0, 0.0, "0"), (-0.2, 0.1, "-0.20 ± 0.10")],
)
def test_nought_has_no_sign(value, std, text):
    assert value_with_uncertainty(value, std) == text


@pytest.mark.parametrize(("value", "shown"), [(-0.0, "0"), (0.0, "0"), (-1.5, "-1.5"), (112503.2, "1.125e+05")])
def test_a_raw_nought_has_no_sign(value, shown):
    from palpate_kit.terminal.quantities import round_number

    assert round_number(value) == shown


@pytest.mark.parametrize("seed", range(20))
def test_no_table_cuts_a_number(capsys, monkeypatch, seed):
    """Beside long names and headings, at every width: in its cell, or row by row."""
    random = np.random.default_rng(seed)
    count = int(random.integers(3, 9))
    headings = ["name", *(" ".join(["heading"] * int(n)) for n in random.integers(1, 4, count))]
    numbers = [
        [f"{random.normal():.{n}f} ± {random.random():.{n}f}" for n in random.integers(1, 5, count)] for _ in "abc"
    ]
    rows = [["n" * int(random.integers(3, 30)), *cells] for cells in numbers]
    monkeypatch.setenv("TERM", "dumb")
    for width in range(40, 200, 4):
        monkeypatch.setenv("COLUMNS", str(width))
        console(width).print(Cells.of("", headings, rows, ["name"]).view())
        shown = capsys.readouterr().out
        assert "…" not in shown
        assert "..." not in shown
        parts = [part for row in rows for cell in row for part in ([cell] if "┃" in shown else cell.split())]
        assert [part for part in parts if part not in shown] == []
        assert max(map(len, shown.splitlines())) <= width
