"""The script of benchmarks, as a function."""

import subprocess
import sys
from pathlib import Path

import pytest

sys.path.append(str(Path(__file__).parents[2] / "benchmarks"))


@pytest.fixture
def reproduce(tmp_path, monkeypatch, capsys):
    """What a process of ``benchmarks/reproduce.py`` would give, in the folder of the test."""
    from reproduce import main

    def called(*words):
        code = 0
        with monkeypatch.context() as patch:
            patch.chdir(tmp_path)
            patch.setenv("COLUMNS", "140")
            patch.setattr(sys, "argv", ["reproduce.py", *map(str, words)])
            try:
                main()
            except SystemExit as end:
                code = end.code or 0
        out, errors = capsys.readouterr()
        return subprocess.CompletedProcess(words, code, out, errors)

    return called
