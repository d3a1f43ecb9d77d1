"""One HTML page of all items; pictures are next to it."""

from __future__ import annotations

from collections.abc import Container, Mapping, Sequence
from html import escape

from palpate import to_si

from reproduction.item import AuthorsRecording, Item
from reproduction.item_rows import Row
from reproduction.item_table import HEADINGS, cells, tally
from reproduction.record_delay import RecordDelay

_STYLE = """body{font:15px/1.5 system-ui,sans-serif;max-width:70rem;margin:2rem auto;padding:0 1rem}
table{border-collapse:collapse;margin:.5rem 0;font-size:13px}td,th{border-bottom:1px solid #ccc;padding:.2rem .6rem;
text-align:left;vertical-align:top}.reproduced{color:#17692a}.simulated,.arithmetic{color:#1f5fa8}
.outside,.failed{color:#b00020;font-weight:bold}.fitted{color:#7b3fa0}img{max-width:100%}code{font-size:12px}"""


def page(
    made: Sequence[tuple[Item, Sequence[Row]]],
    recordings: Mapping[str, AuthorsRecording],
    here: Container[str],
    delays: Mapping[str, RecordDelay],
) -> str:
    """The whole page; `here` are the recordings that it was made with, `delays` what they show of their own delay."""
    body = "".join(_section(item, rows) for item, rows in made)
    first, _, others = tally(made).partition("\n")
    links = "".join(
        f'<li><a href="#{item.name}">{escape(item.label)}</a>: {escape(item.title)}</li>' for item, _ in made
    )
    return (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8"><title>The paper, reproduced</title>'
        f"<style>{_STYLE}</style></head><body><h1>The paper, reproduced</h1><p><strong>{escape(first)}</strong>; "
        f"{escape(others)}.</p><p>Only numbers of <em>recordings</em> count, within twice the combined uncertainty of "
        "both numbers: without what both take from the same model (thickness, radius, Poisson's ratio, lack of fit), "
        "and where the paper states none, by the digits that it prints. <em>Fitted</em>: a constant was chosen so that "
        f"the number comes out.</p><ul>{links}</ul>{body}{_recordings(recordings, here, delays)}</body></html>\n"
    )


def _section(item: Item, rows: Sequence[Row]) -> str:
    text = f'<h2 id="{item.name}">{escape(item.label)}: {escape(item.title)}</h2>'
    if item.note:
        text += f"<p>{escape(item.note)}</p>"
    if rows:
        head = "".join(f"<th>{escape(heading)}</th>" for heading in (*HEADINGS, "why, and what is flagged"))
        text += f"<table><tr>{head}</tr>{''.join(_row(row) for row in rows)}</table>"
    if any(row.ratio is not None for row in rows):
        text += f'<img src="{item.name}.png" alt="ratios">'
    if item.missing:
        lines = "".join(f"<li>{escape(m.what)}: {escape(m.reason)}</li>" for m in item.missing)
        text += f"<p>Not possible from public data:</p><ul>{lines}</ul>"
    return text


def _row(row: Row) -> str:
    texts = "".join(f"<td>{escape(cell)}</td>" for cell in cells(row)[:-1])
    said = "; ".join(part for part in (row.said, ", ".join(row.flags)) if part)
    return f'<tr>{texts}<td class="{row.status.replace(" ", "-")}">{row.status}</td><td>{escape(said)}</td></tr>'


def _recordings(
    recordings: Mapping[str, AuthorsRecording], here: Container[str], delays: Mapping[str, RecordDelay]
) -> str:
    rows = "".join(
        f"<tr><td>{escape(name)}</td><td>{'yes' if name in here else 'no'}</td><td>{_delay(r)}</td>"
        f"<td>{_told(delays.get(r.delay_of))}</td><td>{escape(r.reason)}</td>"
        f"<td><a href='{escape(r.url)}'>{escape(r.path)}</a><br><code>{r.sha256}</code></td></tr>"
        for name, r in recordings.items()
    )
    heads = ("recording", "was here", "late by", "motion late by, as its own kind shows", "why", "file, SHA-256")
    return f"<h2>Recordings</h2><table><tr>{''.join(f'<th>{head}</th>' for head in heads)}</tr>{rows}</table>"


def _delay(recording: AuthorsRecording) -> str:
    late = (("motion", recording.motion_delay), ("force", recording.force_delay))
    text = ", ".join(f"{what} {delay}" for what, delay in late if to_si(delay, "s")) or "-"
    return escape(f"{text} (fitted)" if recording.fitted else text)


def _told(delay: RecordDelay | None) -> str:
    if delay is None:
        return "-"
    return f"{1e3 * delay.delay:.1f} +- {1e3 * delay.std:.1f} ms; together with eta/G {1e3 * delay.together:.1f} ms"
