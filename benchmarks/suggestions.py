"""What `palpate info LOG --suggest` says of public recordings and of mutations of them, and what its pipelines give.

    python benchmarks/suggestions.py [--count 12] [--runs 1] [--seed 1] [--data ../shared/data]

Every recording is tried as it is, and `count` times with other signs, units, orders of columns, headers, rates, clocks
and left-out columns. A suggestion is right where force, position, velocity, their signs and units, and the rate are; a
wrong one is marked where what is wrong in it is said to be a guess. `runs` of each recording are run as they stand.
"""

import argparse
import contextlib
import gzip
import io
import json
import sys
import tempfile
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from palpate import PalpateError
from palpate_engine.cli import call
from palpate_kit.logs.draft_pipeline import recording_of, suggestion_of
from palpate_records.messages.readings import si_unit

sys.path.insert(0, str(Path(__file__).parents[1]))
from tests.records.bags import array_message, write_bag

ARRAY = "std_msgs/msg/Float64MultiArray"


@dataclass
class Column:
    """One column, and what it is: its role, its sign there, its unit."""

    values: np.ndarray
    role: str = ""
    sign: int = 1
    unit: str = "1"
    name: str = ""


@dataclass
class Table:
    """A recording as columns at a rate [Hz]."""

    name: str
    columns: list[Column]
    rate: float
    bag: bool = False
    changes: list[str] = field(default_factory=list)


def recordings(data: Path) -> list[Table]:
    """The public ones."""
    found = []
    for path in sorted((data / "ur3e-bota-2024").glob("*.csv.gz")):
        with gzip.open(path, "rt") as file:
            rows = np.loadtxt(file, delimiter=",")
        roles = [("position", 1, "mm"), ("setpoint", 1, "mm"), ("position", -1, "mm"), ("velocity", -1, "mm/s")]
        roles += [("force", 1, "N"), *[("", 1, "1")] * (rows.shape[1] - 5)]
        found.append(Table(path.name, [Column(rows[:, k], *role) for k, role in enumerate(roles)], 500.0))
    moved = [("position", 1, "m"), ("velocity", 1, "m/s")]
    load = [("time",), ("",), ("setpoint", 1, "m"), *moved, ("force", -1, "N")]
    foam = [
        ("time",),
        ("setpoint", 1, "m"),
        moved[0],
        ("position", -1, "m"),
        moved[1],
        ("force", -1, "N"),
        ("",),
        ("",),
    ]
    known = {"ur3e_load_unload_soft_1": load, "foam_white_1_p": foam}
    for name, roles in known.items():
        path = data / "rosbag2" / f"{name}.db3.gz"
        rows = np.concatenate([batch.values for _, _, batch in recording_of(path).tables(path)])
        rows = rows[:, [k for k in range(rows.shape[1]) if np.isfinite(rows[:, k]).all()][-len(roles) :]]
        time = rows[:, 0]
        columns = [Column(rows[:, k], *role) for k, role in enumerate(roles)]
        found.append(Table(path.name, columns[1:], float(1.0 / np.median(np.diff(time))), bag=True))
    return found


_UNITS = {"position": ("m", "mm", "um"), "velocity": ("m/s", "mm/s", "um/s"), "force": ("N", "mN")}
_NAMES = {"position": "z", "velocity": "vz", "force": "fz", "setpoint": "z_desired", "": "k"}


def mutated(table: Table, rng: np.random.Generator) -> Table:
    """The same with other signs, units, order, rate, and without some of its columns."""
    changes = []
    every = int(rng.choice([1, 1, 2, 5]))
    keep = [c for c in table.columns if c.role in ("force", "position", "velocity") or rng.random() < 0.7]
    if rng.random() < 0.3:
        keep = [c for c in keep if c.role != "velocity"]
        changes.append("no velocity")
    places = [c for c in keep if c.role == "position"]
    if len(places) > 1 and rng.random() < 0.7:
        gone = places[int(rng.integers(len(places)))]
        keep = [c for c in keep if c is not gone]
    flips = {role: int(rng.choice([1, -1])) for role in ("force", "position", "velocity")}
    length = int(rng.integers(3))
    columns = []
    for c in keep:
        role = "position" if c.role == "setpoint" else c.role
        flip, unit = flips.get(role, 1), c.unit
        if role in _UNITS:
            unit = _UNITS[role][length if role != "force" else int(rng.integers(2))]
        factor = si_unit(c.unit)[1] / si_unit(unit)[1]
        columns.append(Column(flip * factor * c.values[::every], c.role, flip * c.sign, unit))
    order = rng.permutation(len(columns))
    changes += [f"1/{every} of the rate", f"signs {list(flips.values())}", f"lengths in {_UNITS['position'][length]}"]
    return Table(table.name, [columns[k] for k in order], table.rate / every, table.bag, changes)


def written(table: Table, folder: Path, rng: np.random.Generator | None) -> tuple[Path, dict[str, str]]:
    """The file, and what a person must say: the rate, where nothing in the file states it."""
    time = np.arange(len(table.columns[0].values)) / table.rate
    if table.bag:
        rows = np.column_stack([time, *(c.values for c in table.columns)])
        messages = [(round(1.7e18) + round(t * 1e9), array_message(row)) for t, row in zip(time, rows, strict=True)]
        return write_bag(folder / "log.db3", [("/data_control", ARRAY, messages)]), {}
    header = clock = "none"
    if rng is not None:
        header = str(rng.choice(["none", "brackets", "suffixes", "names", "vague"]))
        clock = str(rng.choice(["none", "s", "ms", "since 1970"]))
        table.changes += [f"header: {header}", f"time: {clock}"]
    columns, names = [c.values for c in table.columns], []
    for k, c in enumerate(table.columns):
        word = f"{_NAMES[c.role]}{k if c.role == '' else ''}"
        suffix = c.unit.replace("/", "_")
        forms = {"brackets": f"{word} [{c.unit}]", "suffixes": f"{word}_{suffix}", "names": word, "vague": f"ch{k}"}
        names.append(forms.get(header, "") if c.role else f"q{k}")
        c.name = names[-1]
    if clock != "none":
        columns.insert(0, {"s": time, "ms": 1e3 * time, "since 1970": 1.7e9 + time}[clock])
        names.insert(0, "t" if clock != "ms" else "t_ms")
    lines = [] if header == "none" else [",".join(names)]
    lines += [",".join(map(repr, row)) for row in np.column_stack(columns).tolist()]
    (folder / "log.csv").write_text("\n".join(lines) + "\n")
    velocity = any(c.role == "velocity" for c in table.columns)
    return folder / "log.csv", {} if clock != "none" or velocity else {"rate": f"{table.rate:g} Hz"}


def wrong(table: Table, suggestion, choices: dict[str, str], clocked: int) -> dict[str, bool]:
    """What is wrong in a suggestion, and whether it is marked."""
    said = " | ".join(suggestion.doubts)
    entries = suggestion.device.get("columns") or suggestion.device.get("signals")
    found = {}
    for role, entry in entries.items():
        k = entry.get("column", entry.get("index"))
        names = [c.name for c in table.columns]
        column = table.columns[names.index(k) if isinstance(k, str) else int(k) - clocked]
        if column.role != role:
            found[f"{role} is {column.role or 'nothing'}"] = f"{role}:" in said
            continue
        if suggestion.alignment[role]["sign"] != column.sign:
            found[f"sign of {role}"] = "sign of" in said
        if entry["unit"] != column.unit:
            found[f"unit of {role}: {entry['unit']} for {column.unit}"] = (
                f"unit of the {role}" in said or "units:" in said
            )
    rate = suggestion.device.get("rate")
    if rate is not None and "rate" not in choices and abs(float(rate.split()[0]) / table.rate - 1.0) > 1e-6:
        found[f"rate {rate} for {table.rate:g}"] = "rate:" in said
    return found


def run(path: Path, suggestion, log: Path) -> str:
    """What the pipeline gives, in words."""
    from palpate_kit.logs.draft_pipeline import pipeline_of

    path.write_text(pipeline_of(suggestion, log, path.parent))
    heard = io.StringIO()
    try:
        with contextlib.redirect_stdout(heard), contextlib.redirect_stderr(io.StringIO()):
            call(["run", str(path), "--json", "--out", str(path.parent / "out")])
    except (PalpateError, SystemExit) as error:
        return f"refused: {error}"
    words = []
    for label, track in json.loads(heard.getvalue())["tracks"].items():
        found = track["parameters"]
        scales = (("elasticity", 1e-3, "kPa"), ("viscosity", 1.0, "Pa s"))
        cells = [f"{s * found[n]['value']:.4g} {unit}" for n, s, unit in scales if found.get(n, {}).get("value")]
        words.append(f"{label} {', '.join(cells) or 'nothing'}")
    return "; ".join(words)


def main() -> None:
    """Print what was said of each recording, and the counts."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=12)
    parser.add_argument("--runs", type=int, default=1)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--data", type=Path, default=Path(__file__).parents[2] / "shared" / "data")
    options = parser.parse_args()
    print("| recording | tried | right | wrong, said to be a guess | wrong in silence | run as it is |")
    print("|---|---|---|---|---|---|")
    totals = np.zeros(4, int)
    for number, table in enumerate(recordings(options.data)):
        row, given = np.zeros(4, int), []
        for i in range(1 + options.count):
            rng = np.random.default_rng([options.seed, number, i]) if i else None
            tried = table if rng is None else mutated(table, rng)
            with tempfile.TemporaryDirectory() as name:
                folder = Path(name)
                log, choices = written(tried, folder, rng)
                clocked = (
                    1 if tried.bag or any(c.startswith("time:") and c != "time: none" for c in tried.changes) else 0
                )
                suggestion = suggestion_of(log, choices)
                if suggestion.blanks:  # as a person would, who fills it in
                    choices = {**choices, "rate": f"{tried.rate:g} Hz"}
                    suggestion = suggestion_of(log, choices)
                faults = wrong(tried, suggestion, choices, clocked)
                silent = [fault for fault, marked in faults.items() if not marked]
                row += [1, not faults, bool(faults) and not silent, bool(silent)]
                if faults:
                    print(f"  {table.name} {i} {tried.changes}: {faults}", file=sys.stderr)
                if i < options.runs:
                    given.append(run(folder / "log.toml", suggestion, log))
        print(f"| {table.name} | {row[0]} | {row[1]} | {row[2]} | {row[3]} | {' / '.join(given)} |", flush=True)
        totals += row
    print(f"| all | {totals[0]} | {totals[1]} ({100 * totals[1] / totals[0]:.0f} %) | {totals[2]} | {totals[3]} | |")


if __name__ == "__main__":
    main()
