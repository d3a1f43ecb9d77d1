"""One HTML page of all items; pictures are beside it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape

from palpate_reproduction.item import AuthorsRecording, Item
from palpate_reproduction.item_rows import Row
from palpate_reproduction.item_table import HEADINGS, cells, tally

_STYLE = """body{font:15px/1.5 system-ui,sans-serif;max-width:70rem;margin:2rem auto;padding:0 1rem}
table{border-collapse:collapse;margin:.5rem 0;font-size:13px}td,th{border-bottom:1px solid #ccc;padding:.2rem .6rem;
text-align:left;vertical-align:top}.reproduced,.checked{color:#17692a}.agrees{color:#1f5fa8}.outside,.failed{color:#b00020;
font-weight:bold}.shown,.skipped{color:#666}img{max-width:100%}code{font-size:12px}"""


def page(made: Sequence[tuple[Item, Sequence[Row]]], recordings: Mapping[str, AuthorsRecording]) -> str:
    """The whole page."""
    body = "".join(_section(item, rows) for item, rows in made)
    total = tally([row for _, rows in made for row in rows])
    links = "".join(
        f'<li><a href="#{item.name}">{escape(item.label)}</a>: {escape(item.title)}</li>' for item, _ in made
    )
    return (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8"><title>The paper, reproduced</title>'
        f"<style>{_STYLE}</style></head><body><h1>The paper, reproduced</h1><p>{escape(total)}.</p>"
        "<p>Rows from <em>recording</em> are estimated from the authors' public files, <em>arithmetic</em> is the "
        "paper's formula on the paper's numbers; <em>simulated</em> rows come from a simulated rig whose truth differs "
        "from the model that estimates, <em>self-consistency</em> rows from one of the same model: neither counts as "
        f"reproduced.</p><ul>{links}</ul>{body}{_recordings(recordings)}</body></html>\n"
    )


def _section(item: Item, rows: Sequence[Row]) -> str:
    text = f'<h2 id="{item.name}">{escape(item.label)}: {escape(item.title)}</h2>'
    if item.note:
        text += f"<p>{escape(item.note)}</p>"
    if rows:
        head = "".join(f"<th>{escape(heading)}</th>" for heading in (*HEADINGS, "tolerance, and what is flagged"))
        text += f"<table><tr>{head}</tr>{''.join(_row(row) for row in rows)}</table>"
    if any(row.ratio is not None for row in rows):
        text += f'<img src="{item.name}.png" alt="ratios">'
    if item.missing:
        lines = "".join(f"<li>{escape(m.what)}: {escape(m.reason)}</li>" for m in item.missing)
        text += f"<p>Not reproduced:</p><ul>{lines}</ul>"
    return text


def _row(row: Row) -> str:
    texts = "".join(f"<td>{escape(cell)}</td>" for cell in cells(row)[:-1])
    said = "; ".join(part for part in (row.published.reason, row.said, ", ".join(row.flags)) if part)
    return f'<tr>{texts}<td class="{row.status}">{row.status}</td><td>{escape(said)}</td></tr>'


def _recordings(recordings: Mapping[str, AuthorsRecording]) -> str:
    rows = "".join(
        f"<tr><td>{escape(name)}</td><td>{escape(r.motion_delay)}</td><td>{escape(r.force_delay)}</td>"
        f"<td>{escape(r.reason)}</td><td><a href='{escape(r.url)}'>{escape(r.path)}</a><br>"
        f"<code>{r.sha256}</code></td></tr>"
        for name, r in recordings.items()
    )
    head = "<th>recording</th><th>motion late by</th><th>force late by</th><th>why</th><th>file, SHA-256</th>"
    return f"<h2>Recordings</h2><table><tr>{head}</tr>{rows}</table>"
