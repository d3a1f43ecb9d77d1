"""`palpate list`, `describe`, `schema`, `check`, `--version`."""

import importlib.metadata
import json
import subprocess
import sys

import pytest
from palpate.registry import load

PARTS = [(kind, name) for kind, entries in load().parts.items() for name in entries]
HEAVY = ("casadi", "filterpy", "matplotlib", "scipy", "mcap", "serial", "rtde_control", "llvmlite")


def test_version(palpate):
    assert palpate("--version").stdout.strip() == f"palpate {importlib.metadata.version('palpate')}"


def test_list_names_every_part(palpate):
    listed = palpate("list").stdout
    for kind, name in PARTS:
        assert f"[{kind}.*]" in listed
        assert f"  {name} " in listed


@pytest.mark.parametrize(("kind", "name"), PARTS)
def test_describe_says_what_each_key_is(palpate, kind, name):
    part = load().find(kind, name)
    described = palpate("describe", name).stdout
    assert f"a type of [{kind}.*]" in described
    assert part.__doc__.split(".")[0].split("\n")[0] in described
    for key, field in part.model_fields.items():
        assert f"  {key}: " in described
        assert field.description, f"{name}.{key} has no description"
        assert field.description in described


@pytest.mark.parametrize(("table", "words"), [("run", "tracks: list"), ("alignment", "Keys of the table signal:")])
def test_the_tables_of_every_pipeline_are_described(palpate, table, words):
    described = palpate("describe", table).stdout
    assert f"[{table}]: a table of every pipeline" in described
    assert words in described


def test_the_schema_is_json(palpate):
    schema = json.loads(palpate("describe", "schema").stdout)
    assert schema["else"]["required"] == ["device", "alignment", "model", "estimator"]


def test_check_and_the_resolved_pipeline(palpate, point_pipeline):
    assert "is in order: devices rig; tracks dr/ekf" in palpate("check", point_pipeline).stdout
    resolved = palpate("check", point_pipeline, "--resolved").stdout
    assert "radius = 0.005" in resolved
    (point_pipeline.parent / "resolved.toml").write_text(resolved)
    assert palpate("check", "resolved.toml", "--resolved").stdout == resolved


@pytest.mark.slow
@pytest.mark.parametrize("arguments", [["--help"], ["list"], ["--version"], ["run", "--help"]])
def test_looking_around_imports_nothing_heavy(arguments):
    script = (
        "import sys\n"
        f"sys.argv = ['palpate', *{arguments!r}]\n"
        "from palpate_engine.cli import main\n"
        "try:\n    main()\nexcept SystemExit:\n    pass\n"
        f"found = [name for name in {HEAVY!r} if name in sys.modules]\n"
        "sys.exit(f'imported: {found}' if found else 0)\n"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
