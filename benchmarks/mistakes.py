"""Mistakes of laboratories: what every estimator says of each, and what the record could have shown.

``python benchmarks/mistakes.py [KIND ...] [--seeds 5] [-o mistakes.jsonl]``: a line of the file for each palpation;
started again it goes on with those that the file lacks. ``--table`` writes results/flags-measured.md from the file. The
kinds, with their sizes, are in `laboratory/kinds.py`; they were written down before any was run. No force is taken from
the product: each is written out from the literature's formulas.
"""

from __future__ import annotations

import argparse
import json
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import palpate
from laboratory.judgement import MASS, OUTCOMES, SHOWN, outcome, shown
from laboratory.kinds import FORCE, KINDS, LOG, NONE, RIG, SPECIMEN, TIP, TOGETHER, Mistake
from laboratory.sensing import make_log
from palpate_models import DimensionalityReduction, Sphere

ROOT = Path(__file__).parent.parent
ESTIMATORS = ("ekf", "ukf", "kinematic-ekf", "kinematic-smoother", "casadi-fit")
PAGE = ROOT / "benchmarks" / "results" / "flags-measured.md"
BEHIND = "# The verdict, measured on records"  # what `verdicts.py` measures, behind the page
_GROUPS = {"Nothing": (NONE,), "Tip": TIP, "Specimen": SPECIMEN, "Rig": RIG, "Force": FORCE, "Log": LOG}
GROUPS = {**_GROUPS, "Together": TOGETHER}


def measured(mistake: Mistake, seed: int) -> dict[str, Any]:
    """One palpation with a mistake, estimated as if there were none."""
    log = make_log(mistake.palpation(), seed)
    record = palpate.record(
        time=log.stamp, force=log.force, height=log.height, velocity=log.velocity, measuring=log.measuring,
        timing="0.14 ms", tip_mass=MASS,
    )  # fmt: skip
    model = DimensionalityReduction(indenter=Sphere(radius=5e-3), thickness="half-space")
    row: dict[str, Any] = {"kind": mistake.name, "seed": seed}
    try:
        run = palpate.compare(record, models=[model], estimators=ESTIMATORS)
    except palpate.PalpateError as error:  # refused before any estimate
        return row | {"refused": str(error).splitlines()[0]}
    truth = mistake.palpation().truth()
    for estimator in ESTIMATORS:
        track = run.document["tracks"][f"dimensionality-reduction/{estimator}"]
        values = [track["parameters"][name] for name in ("elasticity", "viscosity")]
        row[estimator] = {
            "outcome": outcome(track, truth),
            "error": [None if v["value"] is None else v["value"] / t - 1 for v, t in zip(values, truth, strict=True)],
            "spread": [
                None if v["combined"] is None else v["combined"] / t for v, t in zip(values, truth, strict=True)
            ],
            "flags": sorted({flag["code"] for flag in track["flags"] if flag["severity"] != "note"}),
            "notes": sorted({flag["code"] for flag in track["flags"] if flag["severity"] == "note"}),
        }
    return row


def page(rows: Sequence[dict[str, Any]]) -> str:
    """benchmarks/results/flags-measured.md."""
    return "\n".join([*_head(rows), *(line for name, kinds in GROUPS.items() for line in _group(name, kinds, rows))])


def _head(rows: Sequence[dict[str, Any]]) -> list[str]:
    seeds = len({row["seed"] for row in rows})
    lines = [_INTRODUCTION.format(kinds=len(KINDS) - 1, seeds=seeds)]
    lines += [f"| estimator | {' | '.join(OUTCOMES)} | of the silent ones, the record shows |", "|---|" + "---|" * 6]
    visible = {mistake.name: shown(mistake) > SHOWN for mistake in KINDS}
    for estimator in ESTIMATORS:
        told = [(row["kind"], _outcome(row, estimator)) for row in rows]
        counts = Counter(result for _, result in told)
        seen = sum(result == "silent" and visible[kind] for kind, result in told)
        lines.append(f"| `{estimator}` | {' | '.join(str(counts[name]) for name in OUTCOMES)} | {seen} |")
    return [*lines, ""]


def _group(name: str, kinds: Sequence[Mistake], rows: Sequence[dict[str, Any]]) -> list[str]:
    head = f"| what is wrong | shown | E % | eta % | {' | '.join(f'`{one}`' for one in ESTIMATORS)} | doubts |"
    if not {mistake.name for mistake in kinds} & {row["kind"] for row in rows}:
        return []
    lines = [f"## {name}", "", head, "|---|" + "---|" * (4 + len(ESTIMATORS))]
    for mistake in kinds:
        mine = [row for row in rows if row["kind"] == mistake.name]
        if not mine:
            continue
        sigmas = shown(mistake)
        size = "yes" if np.isinf(sigmas) else f"{sigmas:.0f}" if sigmas >= 10 else f"{sigmas:.1f}"
        errors = [row["casadi-fit"]["error"] for row in mine if "casadi-fit" in row]
        off = [_percent([error[i] for error in errors]) for i in range(2)]
        cells = [_cell([_outcome(row, one) for row in mine]) for one in ESTIMATORS]
        lines.append(f"| {mistake.wrong} | {size} | {' | '.join(off)} | {' | '.join(cells)} | {_doubts(mine)} |")
    return [*lines, ""]


def _outcome(row: dict[str, Any], estimator: str) -> str:
    return "reported" if "refused" in row else str(row[estimator]["outcome"])


def _percent(errors: Sequence[float | None]) -> str:
    known = [error for error in errors if error is not None]
    return f"{100 * float(np.median(known)):+.1f}" if known else "none"


def _cell(outcomes: Sequence[str]) -> str:
    counts = Counter(outcomes)
    parts = [name if count == len(outcomes) else f"{name} {count}" for name, count in counts.most_common()]
    return ", ".join(f"**{part}**" if part.startswith("silent") else part for part in parts)


def _doubts(rows: Sequence[dict[str, Any]]) -> str:
    """Codes that the fit, the smoother and the kinematic filter or the record carry in most of the palpations."""
    if "refused" in rows[0]:
        return "refused"
    codes: Counter[str] = Counter()
    for row in rows:
        codes.update({code for one in ESTIMATORS[2:] for code in row[one]["flags"]})
    return ", ".join(f"`{code}`" for code, count in sorted(codes.items()) if count > len(rows) / 2)


_INTRODUCTION = """# Flags, measured on mistakes

`python benchmarks/mistakes.py --table` writes this page. {kinds} mistakes of laboratories, each with {seeds} seeds: a
palpation is simulated with the mistake (`benchmarks/laboratory`; no force of it is taken from the product) and
estimated as if there were none. E 112 kPa, eta 362 Pa s, a sphere of 5 mm, 0.8 mm at 2 Hz about 4 mm, 10 s at 500 Hz,
noise 0.05 N, 5 um and 0.67 mm/s; the approach through air and the way out are in the record.

- **right**: both values within 2 %, no doubt shown
- **covered**: further off, but within two of the stated uncertainties
- **reported**: the verdict is doubtful or invalid, or the record is refused
- **silent**: beyond two uncertainties, and the verdict is good
- **false alarm**: doubtful, though both values are within 2 %

*shown* is how many standard deviations the record differs from the best that the declared model makes of it: the root
of twice the logarithm of the likelihood ratio of the truth to the declared model, by force and by velocity. Below 3
nothing in the record shows the mistake: what is assumed then has to be declared with its uncertainty. *E* and *eta*
are the median errors of the fit; *doubts* what the fit, the smoother, the kinematic filter or the record are flagged
with.
"""


def main() -> None:
    """Measure what is lacking, and write the page."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("kinds", nargs="*", metavar="KIND", help="names of kinds; all where none is given")
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("-o", "--out", type=Path, default=Path("mistakes.jsonl"))
    parser.add_argument("--table", action="store_true", help="only write the page from the file")
    options = parser.parse_args()
    rows = [json.loads(line) for line in options.out.read_text().splitlines()] if options.out.exists() else []
    have = {(row["kind"], row["seed"]) for row in rows}
    wanted = [mistake for mistake in KINDS if not options.kinds or mistake.name in options.kinds]
    if not options.table:
        with options.out.open("a") as file:
            for mistake in wanted:
                for seed in range(options.seeds):
                    if (mistake.name, seed) not in have:
                        rows.append(measured(mistake, seed))
                        file.write(json.dumps(rows[-1]) + "\n")
                        file.flush()
    text = page(rows)
    if options.table:
        behind = PAGE.read_text(encoding="utf-8").partition(BEHIND)
        PAGE.write_text(text.rstrip() + "\n" + "".join(["\n", *behind[1:]]), encoding="utf-8")
    else:
        print(text)


if __name__ == "__main__":
    main()
