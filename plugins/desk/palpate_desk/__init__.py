"""A folder of curves in the browser: look, mark, change settings, refit, compare, export; all of it files and commands.

`desk_command` begins it, `desk_server` serves the page, `desk` holds what the page shows and does what it asks for,
`page_messages` is the closed list of that, `history_file` the commands that did the same, `curve_answers` and
`refits` fit in processes of their own.
"""

from __future__ import annotations

from palpate import Command, plugin


@plugin
def palpate_commands() -> dict[str, Command]:
    """Return the page of a folder of curves."""
    return {"desk": Command("palpate_desk.desk_command:desk", "A folder of curves in the browser.")}
