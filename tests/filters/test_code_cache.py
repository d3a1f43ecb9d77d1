"""Machine code on disk: used where it is ours and whole, and as if it were not there in every other case."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from palpate_kit.kernel.code_cache import cached_code

CODE = b"code" * 100


@pytest.fixture(name="folder")
def _folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("PALPATE_CACHE", str(tmp_path / "cache"))
    assert cached_code(("a",), lambda: CODE) == CODE
    return tmp_path / "cache" / "kernels"


def made_anew(*causes: str) -> bool:
    made = []
    assert cached_code(causes, lambda: made.append(True) or CODE) == CODE
    return bool(made)


def test_code_is_made_once_for_each_of_its_causes(folder: Path) -> None:
    assert not made_anew("a")
    assert made_anew("b")
    assert made_anew("a", "")  # no two lists of causes share a name
    assert not made_anew("b")


def test_nobody_else_can_read_or_write_it(folder: Path) -> None:
    (file,) = folder.iterdir()
    assert folder.stat().st_mode & 0o777 == 0o700
    assert file.stat().st_mode & 0o777 == 0o600


@pytest.mark.parametrize("damage", ["flipped", "short", "empty"])
def test_what_is_not_what_was_written_is_made_anew_and_mended(folder: Path, damage: str) -> None:
    (file,) = folder.iterdir()
    whole = file.read_bytes()
    file.write_bytes({"flipped": whole[:-1] + b"x", "short": whole[:-1], "empty": b""}[damage])
    assert made_anew("a")
    assert file.read_bytes() == whole
    assert not made_anew("a")


def test_a_file_or_folder_that_others_may_write_to_is_not_read(folder: Path) -> None:
    (file,) = folder.iterdir()
    file.chmod(0o622)
    assert made_anew("a")
    folder.chmod(0o770)
    assert made_anew("a")


def test_a_link_is_not_followed(folder: Path, tmp_path: Path) -> None:
    (file,) = folder.iterdir()
    elsewhere = tmp_path / "elsewhere"
    file.rename(elsewhere)
    file.symlink_to(elsewhere)
    assert made_anew("a")
    moved = folder.rename(tmp_path / "moved")
    folder.symlink_to(moved)
    assert made_anew("a")


def test_a_disk_that_cannot_be_written_to_and_a_wish_not_to_are_no_errors(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "file").write_text("no folder")
    monkeypatch.setenv("PALPATE_CACHE", str(tmp_path / "file"))
    assert made_anew("a")
    monkeypatch.setenv("PALPATE_CACHE", "off")
    assert made_anew("a")
    assert made_anew("a")


def test_the_oldest_go(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("palpate_kit.kernel.code_cache._MAX_FILES", 2)
    (file,) = folder.iterdir()
    os.utime(file, (1, 1))
    assert made_anew("b")
    assert made_anew("c")
    assert len(list(folder.iterdir())) == 2
    assert made_anew("a")


PROGRAM = """
import casadi as ca, numpy as np
from palpate_kit.kernel import llvm
x, w, p = (ca.SX.sym(*name) for name in (("x", 2), ("w", 2), ("p", 1)))
step = ca.Function("step", [x, w, p], [x * p + ca.exp(w), ca.fabs(w) ** p + ca.sin(x)])
samples = np.linspace(-1, 1, 200).reshape(100, 2)
translated, count = llvm._translated, []
llvm._translated = lambda *given: count.append(1) or translated(*given)
state, outputs = llvm.CompiledStep(step).run(np.zeros(2), samples, np.array([0.3]))
print(len(count), state.tobytes().hex(), outputs.tobytes().hex())
"""


@pytest.mark.slow
def test_another_process_runs_the_kept_code_and_gets_the_same_bits(tmp_path: Path) -> None:
    surroundings = {**os.environ, "PALPATE_CACHE": str(tmp_path)}
    first, second = (
        subprocess.run([sys.executable, "-c", PROGRAM], env=surroundings, capture_output=True, text=True, check=True)
        for _ in range(2)
    )
    (made, *numbers), (again, *same) = first.stdout.split(), second.stdout.split()
    assert (made, again) == ("1", "0")
    assert numbers == same
