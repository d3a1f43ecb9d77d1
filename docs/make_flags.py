"""Write docs/flags.md from the registry of flags: ``python docs/make_flags.py``."""

from pathlib import Path

from palpate.flags import SEVERITIES
from palpate.registry import Registry, load

_HEAD = """# Flags

A result never hides a failed assumption: it carries flags, each a code, a sentence and a severity. The verdict of a
track is the worst severity among its flags and those of the record, `good` where there is none. The numbers of a track
that is `invalid` are not shown, and no statistic or comparison uses them. `palpate describe CODE` says the same as this
page, which `docs/make_flags.py` writes from the registry of flags. A plugin registers its own by the hook
`palpate_flags`.
"""


def page(registry: Registry) -> str:
    """The page, with every flag by severity and code."""
    lines = [_HEAD]
    for severity, words in SEVERITIES.items():
        lines += [f"## {severity}: {words}", "", "| code | what it says | what to do |", "|---|---|---|"]
        for code, entry in sorted(registry.flags.items()):
            if entry.meaning.severity == severity:
                lines.append(f"| `{code}` | {entry.meaning.meaning} | {entry.meaning.remedy} |")
        lines.append("")
    return "\n".join(lines)


if __name__ == "__main__":
    Path(__file__).with_name("flags.md").write_text(page(load()), encoding="utf-8")
