"""A paper's tables and figures, each as settings, reproduced from recordings and compared with them."""

from __future__ import annotations

from palpate import Command, plugin


@plugin
def palpate_commands() -> dict[str, Command]:
    """One command."""
    return {
        "reproduce": Command(
            "palpate_reproduction.reproduce_command:reproduce", "Reproduce the paper's tables and figures.", "compare"
        ),
    }
