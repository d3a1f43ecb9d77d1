"""What `.ci/run` runs besides its fixed set: the tests that go with a change."""

import importlib.util
import shutil
import subprocess

import pytest


@pytest.fixture(scope="module")
def gate(root):
    """`.ci/changed_tests.py` as a module."""
    spec = importlib.util.spec_from_file_location("changed_tests", root / ".ci" / "changed_tests.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize(
    ("changed", "tests"),
    [
        ([], []),
        (["README.md", "docs/decisions/README.md", ".ci/verified", "plugins/README.md"], []),
        (["plugins/maps/palpate_maps/lumps.py"], ["tests/maps"]),
        (["plugins/commands/palpate_commands/run_command.py"], ["tests/cli", "tests/starting"]),
        (["plugins/fits/README.md", "tests/fits/test_fit.py"], ["tests/curves", "tests/fits"]),
        (["tests/engine/live.py", "tests/test_names.py"], ["tests/engine", "tests/test_names.py"]),
        (["tests/third_party/palpate-punch/x.py"], ["tests/test_third_party.py", "tests/third_party"]),
        (["docs/tutorials/arrays.md", "pipelines/parts/x.toml"], ["tests/test_pipelines.py", "tests/test_walks.py"]),
        ([f"plugins/{name}/x.py" for name in ("maps", "desk", "logs", "ros2")], ["maps", "desk", "logs", "ros2"]),
    ],
)
def test_a_change_has_its_tests(gate, changed, tests):
    assert gate.tests_of(changed) == sorted(test if "/" in test else f"tests/{test}" for test in tests)


@pytest.mark.parametrize(
    ("changed", "why"),
    [
        (["plugins/maps/x.py", "core/palpate_kit/jobs/y.py"], "core/palpate_kit/jobs/y.py has changed"),
        (["tests/conftest.py"], "tests/conftest.py has changed"),
        (["tests/processes.py"], "tests/processes.py has changed"),
        (["pyproject.toml"], "pyproject.toml has changed"),
        ([f"plugins/{name}/x.py" for name in "abcde"], "5 families have changed"),
    ],
)
def test_a_change_of_what_everything_stands_on_needs_a_full_run(gate, changed, why):
    with pytest.raises(gate.FullRunDueError, match=why):
        gate.tests_of(changed)


def test_every_folder_of_tests_belongs_to_a_family_or_the_core(gate, root):
    families = [path.parent.name for path in root.glob("plugins/*/README.md")]
    named = {folder for family in families for folder in gate.FOLDERS.get(family, (family,))}
    folders = {path.parent.name for path in root.glob("tests/*/test_*.py")}
    assert folders - named == {"core", "engine", "kit", "records", "reproduction"}
    assert named - folders == set()
    assert all((root / place).exists() and (root / test).exists() for place, test in gate.OTHERS.items())


def test_the_fixed_set_has_one_of_each_kind(root):
    """Of each folder with slow tests."""
    folders = {}
    for path in root.glob("tests/*/test_*.py"):
        folders[path.parent.name] = folders.get(path.parent.name, "") + path.read_text()
    slow = {folder for folder, text in folders.items() if "mark.slow" in text}
    assert {folder for folder in slow if "mark.gate" not in folders[folder]} == set()


def git(folder, *words):
    """What git says, as somebody without settings."""
    who = ("-c", "user.name=a", "-c", "user.email=a@b", "-c", "commit.gpgsign=false")
    return subprocess.run(["git", *who, *words], cwd=folder, check=True, capture_output=True, text=True).stdout.strip()


@pytest.mark.skipif(shutil.which("git") is None, reason="no git here")
def test_changes_are_counted_from_a_commit_before(gate, tmp_path):
    git(tmp_path, "init")
    (tmp_path / "a b.py").write_text("1")
    git(tmp_path, "add", ".")
    git(tmp_path, "commit", "-m", "first")
    first = git(tmp_path, "rev-parse", "HEAD")
    assert gate.changed_since(first, tmp_path) == []
    (tmp_path / "é.py").write_text("2")
    git(tmp_path, "add", ".")
    git(tmp_path, "commit", "-m", "second")
    (tmp_path / "a b.py").write_text("not committed")
    assert gate.changed_since(first, tmp_path) == ["a b.py", "é.py"]
    second = git(tmp_path, "rev-parse", "HEAD")
    git(tmp_path, "stash")
    git(tmp_path, "checkout", first)
    for commit in (second, "", "0" * 40, "nonsense"):
        with pytest.raises(gate.FullRunDueError, match=r"\.ci/verified names no commit before this one"):
            gate.changed_since(commit, tmp_path)


def test_without_git_a_full_run_is_due(gate, tmp_path, monkeypatch):
    monkeypatch.setenv("GIT_CEILING_DIRECTORIES", str(tmp_path.parent))
    with pytest.raises(gate.FullRunDueError, match="names no commit"):
        gate.changed_since("HEAD", tmp_path)
    monkeypatch.setenv("PATH", "")
    with pytest.raises(gate.FullRunDueError, match="no git"):
        gate.changed_since("HEAD", tmp_path)
