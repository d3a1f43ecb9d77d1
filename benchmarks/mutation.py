"""Which wrong programs the tests let pass: mutants drawn at random from what numbers and safety depend on.

    pip install cosmic-ray
    python benchmarks/mutation.py [--count 30] [--seed 1] [--only guard] [-o mutants.jsonl]
    python benchmarks/mutation.py --again mutants.jsonl   survivors of then against the tests of now

Of each area, `--count` mutants are drawn (a comparison, a number, a sign, a condition changed) and the area's tests run
against each, in a copy of the checkout. A line is written for each mutant as soon as it is judged, and a file that is
there is gone on with. An area whose tests do not pass without a mutant is refused. Survivors are printed as
differences: each is a missing test, or a change that changes nothing.
"""

import argparse
import json
import os
import random
import shlex
import shutil
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Iterable, Iterator
from functools import cache
from pathlib import Path

from cosmic_ray.ast import ast_nodes, get_ast_from_path
from cosmic_ray.mutating import mutate_and_test
from cosmic_ray.plugins import get_operator

ROOT = Path(__file__).parents[1]
_QUIET: dict = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL, "timeout": 600}
_UNCERTAINTY = "plugins/uncertainty/palpate_uncertainty"
_ALIGNMENT, _FITS = "core/palpate_engine/alignment", "plugins/fits/palpate_fits"
_KERNEL, _COLUMNS = "core/palpate_kit/kernel", "plugins/fits/palpate_fits/columns"
_LACK = "uncertainty/test_lack_of_fit.py uncertainty/test_lack_of_fit_of_sweeps.py uncertainty/test_whitening.py"
_BUDGET = "uncertainty/test_budget.py uncertainty/test_budget_command.py"
_SPREAD = "uncertainty/test_settling.py uncertainty/test_stretches.py uncertainty/test_timing.py"
_READ = (
    "records/test_mcap_reader.py records/test_recovery.py records/test_damage.py devices/test_mcap.py "
    "logs/test_corpus.py"
)
AREAS = {  # by area: modules and the tests that hold them; of several patterns that match, the first counts
    "alignment": {
        f"{_ALIGNMENT}/c*.py {_ALIGNMENT}/slow_rise.py {_ALIGNMENT}/held_samples.py {_ALIGNMENT}/load_compensation.py":
            "engine/test_contact_detector.py engine/test_alignment.py",
        f"{_ALIGNMENT}/*.py": "engine/test_alignment.py engine/test_ports.py engine/test_contact_detector.py",
    },
    "guard": {
        "core/palpate_engine/pipeline/live/guard.py core/palpate_engine/pipeline/live/*_watch.py "
        "core/palpate_engine/safety/*.py core/palpate/arm_limits.py":
            "engine/test_safety.py devices/test_fence.py",
    },
    "fence": {
        "core/palpate_arms/fence.py": "devices/test_fence.py",
        "core/palpate_arms/force_watch.py": "devices/test_force_watch.py engine/test_touch_watch.py",
        "core/palpate_arms/force_control.py": "devices/test_force_hold.py",
    },
    "uncertainty": {
        f"{_UNCERTAINTY}/[lwa]*.py {_UNCERTAINTY}/unloading.py": f"{_LACK} uncertainty/test_late_force.py",
        f"{_UNCERTAINTY}/delay/timed_record.py {_UNCERTAINTY}/delay/response_laws.py {_UNCERTAINTY}/delay/delay_f*.py":
            "uncertainty/test_self_timed.py",
        f"{_UNCERTAINTY}/model_choice.py": "uncertainty/test_choice.py",
        f"{_UNCERTAINTY}/choose_command.py {_UNCERTAINTY}/held_out.py": "uncertainty/test_choose.py",
        f"{_UNCERTAINTY}/monte_carlo.py": "uncertainty/test_monte_carlo.py",
        f"{_UNCERTAINTY}/delay/one_frequency.py": "uncertainty/test_one_frequency.py",
        f"{_UNCERTAINTY}/plausibility.py {_UNCERTAINTY}/outliers.py": "uncertainty/test_implausible.py",
        f"{_UNCERTAINTY}/*.py": f"{_BUDGET} {_SPREAD}",
        f"{_FITS}/uncertainty.py {_FITS}/identifiability.py": "fits/test_fit.py",
    },
    "kernel": {
        "plugins/filters/palpate_filters/c_export/c_source.py": "filters/test_export_filter.py",
        f"{_KERNEL}/*.py {_COLUMNS}/*.py": "filters/test_kernel.py fits/test_columns.py filters/test_code_cache.py",
    },
    "readers": {
        "plugins/devices/palpate_devices/mcap_replay.py core/palpate_records/mcap/*.py": _READ,
        "core/palpate_records/tables/*.py plugins/logs/palpate_logs/csv_replay.py":
            "logs/test_csv_replay.py logs/test_csv_plain.py",
    },
}  # fmt: skip
OPERATORS = (
    "NumberReplacer", "AddNot", "ReplaceTrueWithFalse", "ReplaceFalseWithTrue", "ReplaceAndWithOr", "ReplaceOrWithAnd",
    "ReplaceBreakWithContinue", "ReplaceContinueWithBreak", "ZeroIterationForLoop", "ReplaceUnaryOperator_Delete_USub",
    "ReplaceUnaryOperator_Delete_Not", "ReplaceBinaryOperator_Add_Sub", "ReplaceBinaryOperator_Sub_Add",
    "ReplaceBinaryOperator_Mul_Div", "ReplaceBinaryOperator_Div_Mul", "ReplaceComparisonOperator_Lt_GtE",
    "ReplaceComparisonOperator_Gt_LtE", "ReplaceComparisonOperator_LtE_Lt", "ReplaceComparisonOperator_GtE_Gt",
    "ReplaceComparisonOperator_Eq_NotEq", "ReplaceComparisonOperator_NotEq_Eq",
)  # fmt: skip


def main() -> None:
    """Draw, test, and print what survived."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=30, help="mutants of each area")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", choices=AREAS, action="append")
    parser.add_argument("--again", type=Path, metavar="MUTANTS", help="what survived in this file")
    parser.add_argument("-o", "--out", type=Path, default=Path("mutants.jsonl"))
    options = parser.parse_args()
    known = [json.loads(line) for line in options.out.read_text().splitlines()] if options.out.exists() else []
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder) / "checkout"
        shutil.copytree(ROOT, copy, ignore=shutil.ignore_patterns(".git", ".venv", "__pycache__", ".*_cache"))
        os.chdir(copy)
        run = Path("run_tests.py")
        run.write_text(f"import sys\nsys.path[:0] = {_packages(copy)!r}\nimport pytest\nsys.exit(pytest.main())\n")
        os.environ["PYTHONDONTWRITEBYTECODE"] = "1"
        if options.again is not None:
            _print(list(_again(options.again, options.only or AREAS)))
            return
        for area in options.only or AREAS:
            known += _judge(area, options, {_name(one) for one in known})
    _print(known)


def _packages(copy: Path) -> list[str]:
    return [str(copy / "core"), *(str(path) for path in sorted((copy / "plugins").iterdir()) if path.is_dir())]


def _judge(area: str, options: argparse.Namespace, done: set[tuple]) -> list[dict]:
    tests = _tests_of(area)
    every = [place for module in sorted(tests) for place in _places(Path(module))]
    drawn = random.Random(f"{options.seed} {area}").sample(every, min(options.count, len(every)))
    judged = []
    for path, operator, occurrence in drawn:
        one = {"area": area, "file": path, "operator": operator, "occurrence": occurrence}
        if _name(one) in done:
            continue
        one |= _outcome(path, operator, occurrence, _command(tests[path]))
        judged.append(one)
        with (ROOT / options.out).open("a") as file:
            file.write(json.dumps(one) + "\n")
        print(f"{area:12}{one['outcome']:10}{path}: {operator} {occurrence}", flush=True)
    return judged


def _tests_of(area: str) -> dict[str, str]:
    """The tests of every module of an area."""
    found: dict[str, str] = {}
    for patterns, tests in AREAS[area].items():
        for module in (path.as_posix() for pattern in patterns.split() for path in Path().glob(pattern)):
            found.setdefault(module, tests)
    return found


@cache
def _command(tests: str) -> str:
    """The command that runs some tests; ends the program where they fail without any mutant."""
    paths = " ".join(f"tests/{test}" for test in tests.split())
    command = f'{sys.executable} run_tests.py -q -x -n 0 -p no:cacheprovider -m "not live" {paths}'
    if subprocess.run(shlex.split(command), stdout=subprocess.DEVNULL).returncode:
        sys.exit(f"these tests fail without any mutant: {command}")
    return command


def _again(file: Path, areas: Iterable[str]) -> Iterator[dict]:
    """Judge once more what survived, by the lines that were changed; those that are not there any more are left out."""
    rows = [json.loads(line) for line in file.read_text().splitlines()]
    for area in areas:
        survivors = [row for row in rows if row["area"] == area and row["outcome"] == "survived"]
        tests = _tests_of(area)
        for row in survivors:
            command = _command(tests[row["file"]]) if row["file"] in tests else ""
            module, outcome = Path(row["file"]), "gone"
            old, new = ("\n".join(line[1:] for line in _changed(row["difference"], sign)) for sign in "-+")
            text = module.read_text() if module.exists() else ""
            if command and text.count(old) == 1:
                module.write_text(text.replace(old, new))
                try:
                    outcome = "killed" if subprocess.run(shlex.split(command), **_QUIET).returncode else "survived"
                except subprocess.TimeoutExpired:
                    outcome = "killed"
                module.write_text(text)
            print(f"{area:12}{outcome:10}{row['file']}: {new.strip()}", flush=True)
            if outcome != "gone":
                yield row | {"outcome": outcome}


def _changed(difference: str, sign: str) -> list[str]:
    return [line for line in difference.splitlines() if line.startswith(sign) and not line.startswith(3 * sign)]


def _places(module: Path) -> list[tuple[str, str, int]]:
    """Where a mutant may be made: not in words, which no test should repeat."""
    nodes, lines = list(ast_nodes(get_ast_from_path(module))), module.read_text().splitlines()
    return [
        (module.as_posix(), f"core/{name}", occurrence)
        for name in OPERATORS
        for occurrence, ((line, _), _) in enumerate(
            place for node in nodes for place in get_operator(f"core/{name}")().mutation_positions(node)
        )
        if 'f"' not in lines[line - 1] and "description" not in lines[line - 1]
    ]


def _outcome(path: str, operator: str, occurrence: int, command: str) -> dict:
    class Mutation:
        module_path, operator_name, operator_args = Path(path), operator, {}

    Mutation.occurrence = occurrence
    result = mutate_and_test([Mutation], command, 600)
    outcome = result.test_outcome.value if result.test_outcome else "no test"
    return {"outcome": outcome, "difference": result.diff}


def _name(one: dict) -> tuple:
    return one["file"], one["operator"], one["occurrence"]


def _print(judged: list[dict]) -> None:
    for one in judged:
        if one["outcome"] == "survived":
            print(f"\n{one['file']}: {one['operator']} {one['occurrence']}\n{one['difference']}")
    print(f"\n{'area':14}{'mutants':>8}{'killed':>8}{'%':>7}")
    for area in AREAS:
        count = Counter(one["outcome"] for one in judged if one["area"] == area)
        if total := sum(count.values()):
            print(f"{area:14}{total:8}{count['killed']:8}{100 * count['killed'] / total:7.1f}")


if __name__ == "__main__":
    main()
