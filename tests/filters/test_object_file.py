"""Machine code of an object file without LLVM: the same bits, and what is not known is left to LLVM."""

import os
import struct
import subprocess
import sys
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

pytest.importorskip("llvmlite")
from palpate_filters.kernel import llvm
from palpate_filters.kernel.object_file import ObjectFile, UnknownError, here

if not here():
    pytest.skip("object files are loaded on Linux and x86-64 only", allow_module_level=True)

X, W, P = ca.SX.sym("x", 3), ca.SX.sym("w", 2), ca.SX.sym("p", 2)
NEXT = ca.vertcat(X[0] + W[0] * P[0], ca.exp(-(X[1] ** 2)) + W[1], ca.tanh(X[2]) * ca.sin(P[1]) + 0.3)
STEP = ca.Function(
    "step", [X, W, P], [NEXT, ca.vertcat(ca.fabs(X[0]) ** 1.5 + ca.log(2.0 + X[1] ** 2), ca.erf(X[2]) / 7.0)]
)


@pytest.fixture(scope="module")
def code():
    """The object file of a step with constants and functions of the C library."""
    return llvm._translated(STEP.serialize(), llvm._machine(), llvm.Translation)


def run(address):
    """State and outputs after 200 samples."""
    pointer = llvm.ctypes.c_void_p
    block = llvm.ctypes.CFUNCTYPE(None, llvm.ctypes.c_int64, *([pointer] * 4))(address("run"))
    samples = np.random.default_rng(3).normal(size=(200, 2))
    arrays = [np.array([0.1, 0.2, 0.3]), samples, np.array([0.4, 0.5]), np.empty((200, 2))]
    block(200, *(array.ctypes.data for array in arrays))
    return np.concatenate([arrays[0], arrays[3].ravel()])


def test_the_bits_are_those_of_llvm(code):
    functions = llvm._functions()
    found, expected = run(ObjectFile(code).loaded(functions)), run(llvm._loaded_by_llvm(code))
    assert np.isfinite(found).all()
    assert found.tobytes() == expected.tobytes()


def test_code_is_never_writable_and_executable(code):
    place = ObjectFile(code).loaded(llvm._functions())("run")
    for line in Path("/proc/self/maps").read_text().splitlines():
        low, high = (int(word, 16) for word in line.split()[0].split("-"))
        if low <= place < high:
            assert line.split()[1] == "r-xp"
            return
    raise AssertionError


def sections(code):
    at, count = struct.unpack_from("<Q", code, 40)[0], struct.unpack_from("<H", code, 60)[0]
    return [(at + 64 * i, struct.unpack_from("<2I4Q2I2Q", code, at + 64 * i)) for i in range(count)]


def changed(code, at, form, value):
    other = bytearray(code)
    struct.pack_into(form, other, at, value)
    return bytes(other)


def faults(code):
    relocations = next(row for _, row in sections(code) if row[1] == 4 and row[5] >= 24)
    symbols = next((at, row) for at, row in sections(code) if row[1] == 2)
    data = next(at for at, row in sections(code) if row[1] == 1 and row[2] & 2 and row[5])
    yield "another machine", changed(code, 18, "<H", 183)
    yield "a program", changed(code, 16, "<H", 2)
    yield "another kind of relocation", changed(code, relocations[4] + 8, "<I", 2)
    yield "a symbol that is not there", changed(code, relocations[4] + 12, "<I", 1 << 20)
    yield "beyond the section", changed(code, relocations[4], "<Q", 1 << 30)
    yield "a section that is written to", changed(code, data + 8, "<Q", 3)
    yield "cut off", code[: len(code) // 2]
    yield "no symbols", changed(code, symbols[0] + 4, "<I", 1)
    yield "nothing", b""
    yield "something else", b"MZ" + code[2:]


def test_what_is_not_known_is_left_to_llvm(code):
    known = []
    for name, other in faults(code):
        try:
            ObjectFile(other).loaded(llvm._functions())
            known.append(name)
        except UnknownError:
            pass
    assert known == []
    with pytest.raises(UnknownError, match="palpate_"):
        ObjectFile(code).loaded({})


def test_llvm_takes_over_and_the_bits_stay(monkeypatch, code):
    def refuse(content):
        raise UnknownError("nothing is known")

    expected = run(llvm._addresses("step", STEP.serialize(), llvm.Translation))
    monkeypatch.setattr(llvm, "ObjectFile", refuse)
    assert run(llvm._addresses("step", STEP.serialize(), llvm.Translation)).tobytes() == expected.tobytes()
    assert run(llvm._loaded_by_llvm(code)).tobytes() == expected.tobytes()


AGAIN = """
import sys
import casadi as ca
from palpate_filters.kernel.llvm import CompiledStep
import numpy as np
x, w, p = ca.SX.sym("x"), ca.SX.sym("w"), ca.SX.sym("p")
step = CompiledStep(ca.Function("step", [x, w, p], [x + w * p, ca.exp(x)]))
print(step.run(np.zeros(1), np.ones((5, 1)), np.ones(1))[0][0], "llvmlite" in sys.modules)
"""


@pytest.mark.slow
def test_code_that_is_kept_needs_no_llvm(tmp_path):
    for imported in (True, False):
        done = subprocess.run(
            [sys.executable, "-c", AGAIN],
            capture_output=True,
            text=True,
            check=True,
            env={**os.environ, "PALPATE_CACHE": str(tmp_path)},
        )
        assert done.stdout.split() == ["5.0", str(imported)]
