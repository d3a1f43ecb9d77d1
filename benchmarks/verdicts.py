"""The verdict, judged: records whose truth is known, right and wrong, and what the product says of each.

``python benchmarks/verdicts.py N SEED [--rows right,nothing,wrong,memory,hidden,real] [-o FILE] [--table FILE]``: N
records of each rig that are right, with everything stated and with nothing but the tip; of each of forty kinds of wrong
at 6, 12 and 50 standard deviations of its own pattern; of a material with memory, under a right rig and under one of
which a fact is wrong; of each of fifteen kinds of wrong that no record shows. Kinds and sizes are in `verdict_records`,
written down before the first run; no formula is taken from the product. With ``-o`` each record is a
line of a file, and a run goes on with those that it lacks; ``--table`` only prints the matrix of such a file.
"""

from __future__ import annotations

import argparse
import json
import os
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from verdict_records.files import drawn, random_of, write
from verdict_records.hidden import HIDDEN
from verdict_records.judgement import judged
from verdict_records.matrix import matrix
from verdict_records.real_logs import REAL, judged_log
from verdict_records.remembering import FACTS, SIGMA, remembering
from verdict_records.rigs import RIGS
from verdict_records.sizes import readings, size_of
from verdict_records.wrongs import WRONGS

SIGMAS = (6, 12, 50)
ROWS = ("right", "nothing", "wrong", "memory", "hidden", "real")
_KINDS = {kind.name: kind for kind in WRONGS}
Case = dict[str, Any]


def cases(count: int, rows: Sequence[str]) -> Iterator[Case]:
    """What is to be judged, by row of the matrix."""
    for row in ("right", "nothing"):
        if row in rows:
            yield from ({"row": row, "rig": rig, "number": i} for i in range(count) for rig in RIGS)
    if "wrong" in rows:
        for i in range(count):
            for kind in WRONGS:
                rig = kind.rigs[i % len(kind.rigs)]
                yield from ({"row": "wrong", "kind": kind.name, "rig": rig, "number": i, "sigma": k} for k in SIGMAS)
    if "memory" in rows:
        for i in range(count):
            yield from ({"row": "memory", "kind": "", "rig": rig, "number": i} for rig in ("press", "robot", "texture"))
            for name in FACTS:
                rig = _KINDS[name].rigs[i % len(_KINDS[name].rigs)]
                yield {"row": "memory", "kind": name, "rig": rig, "number": i}
    if "hidden" in rows:
        for i in range(count):
            for hidden in HIDDEN:
                rig = hidden.rigs[i % len(hidden.rigs)]
                yield {"row": "hidden", "kind": hidden.name, "rig": rig, "number": i}
    if "real" in rows:
        yield from ({"row": "real", "kind": name, "stated": stated} for name in REAL for stated in (True, False))


def measured(case: Case, seed: int, folder: Path) -> Case:
    """A case with what is said of it; `unreachable` where no size that a laboratory has shows so much."""
    if case["row"] == "real":
        return case | judged_log(_shared() / "data" / "ur3e-bota-2024" / f"{case['kind']}.csv.gz", case)
    row = (
        "right" if case["row"] == "nothing" else case["row"]
    )  # the same records with everything stated and with nothing
    random = random_of(seed, row, case["rig"], case.get("kind", ""), case["number"])
    specimen = drawn(case["rig"], random)
    truth = {"truth": {"elasticity": specimen.elasticity, "viscosity": specimen.viscosity}}
    name, found = "record", None
    if case["row"] == "wrong":
        kind = _KINDS[case["kind"]]
        size = size_of(specimen, kind, case["sigma"])
        if size is None:
            return case | {"unreachable": True}
        truth["size"] = size
        name, found = "cut" if kind.place == "cut" else name, readings(specimen, kind, size)
    elif case["row"] == "memory":
        material, fact = remembering(specimen, random), _KINDS.get(case["kind"])
        truth = {"truth": dict(zip(("elasticity", "viscosity"), material.apparent, strict=True))}
        size = 0.0 if fact is None else size_of(specimen, fact, SIGMA)
        if size is None:
            return case | {"unreachable": True}
        truth["size"] = size
        name, found = "cut" if fact and fact.place == "cut" else name, readings(material, fact, size)
    elif case["row"] == "hidden":
        found = next(kind for kind in HIDDEN if kind.name == case["kind"]).make(specimen)
    path = write(folder / name, specimen.rig, found or readings(specimen), random)
    return case | truth | judged(path, specimen.rig, case["row"] != "nothing")


def _shared() -> Path:
    return Path(os.environ.get("PALPATE_SHARED", Path(__file__).parents[2] / "shared"))


def main() -> None:
    """Judge what is lacking, and print the matrix."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("count", type=int, metavar="N")
    parser.add_argument("seed", type=int, metavar="SEED")
    parser.add_argument("--rows", default=",".join(ROWS), help="rows of the matrix")
    parser.add_argument("-o", "--out", type=Path, help="a file with a line for each record")
    parser.add_argument("--table", type=Path, help="only print the matrix of such a file")
    options = parser.parse_args()
    if options.table is not None:
        print(matrix([json.loads(line) for line in options.table.read_text().splitlines()]))
        return
    out = options.out
    known = [json.loads(line) for line in out.read_text().splitlines()] if out is not None and out.exists() else []
    have = {_key(row) for row in known}
    with tempfile.TemporaryDirectory() as folder:
        for case in cases(options.count, options.rows.split(",")):
            if _key(case) in have:
                continue
            known.append(measured(case, options.seed, Path(folder)))
            if out is not None:
                with out.open("a") as file:
                    file.write(json.dumps(known[-1], default=float) + "\n")
    print(matrix(known))


def _key(case: Case) -> tuple[Any, ...]:
    return tuple(case.get(name) for name in ("row", "kind", "rig", "number", "sigma", "stated"))


if __name__ == "__main__":
    main()
