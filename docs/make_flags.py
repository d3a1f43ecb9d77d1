"""Write docs/flags.md from the registry of flags: ``python docs/make_flags.py``."""

from pathlib import Path

from palpate.flags import SEVERITIES
from palpate.registry import Registry, load

_HEAD = """# Flags

A result never hides a failed assumption: it carries flags, each a code, a sentence, a severity and what to do. What the
verdict of a value and of a track is, and what is a condition and no flag: [verdict](verdict.md). The numbers of a track
that is `invalid` are not shown, and no statistic or comparison uses them. `palpate describe CODE` says the same as this
page, which `docs/make_flags.py` writes from the registry of flags. A plugin registers its own by `palpate_flags`.

**What becomes of a flag.** A *finding* speaks against a value; a *note* is for information; what nobody has
stated and no record shows is a *condition* and no flag. The file that decides is
`core/palpate_engine/result/materiality.py`:

- A flag says by how much what it names can move each value. It is a doubt where that is more than the value's combined
  standard uncertainty *without* the flag's own row of the budget, so that a larger uncertainty makes no doubt smaller,
  and where it is not known.
- What moves less is a row of the budget, and stands under `immaterial` in `result.json`.
- A code that is a sign of another raises that one, and stands under its `evidence`: one cause, one flag. What a later
  diagnosis finds to be harmless moves nothing.
- The terminal shows at most three flags of a track, those that move a value most.

What is flagged on real logs, and whether it is true: [measured](../benchmarks/results/flags-real-logs.md). What is said of 99 mistakes of
laboratories: [measured](../benchmarks/results/flags-measured.md).
"""


def page(registry: Registry) -> str:
    """The page, with every flag by severity and code."""
    lines = [_HEAD]
    for severity, words in SEVERITIES.items():
        lines += [f"## {severity}: {words}", "", "| code | what it says | what to do |", "|---|---|---|"]
        for code, entry in sorted(registry.flags.items()):
            if entry.meaning.severity == severity and not entry.meaning.evidence_of:
                lines.append(f"| `{code}` | {entry.meaning.meaning} | {entry.meaning.remedy} |")
        lines.append("")
    lines += ["## Signs", "", "| sign | of | what it says |", "|---|---|---|"]
    signs = {code: entry.meaning for code, entry in registry.flags.items() if entry.meaning.evidence_of}
    lines += [f"| `{code}` | `{signs[code].evidence_of}` | {signs[code].meaning} |" for code in sorted(signs)]
    lines.append("")
    return "\n".join(lines)


if __name__ == "__main__":
    Path(__file__).with_name("flags.md").write_text(page(load()), encoding="utf-8")
