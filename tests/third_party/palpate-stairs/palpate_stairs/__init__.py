"""A staircase of presses, its command and its section of a report."""

from __future__ import annotations

from typing import TYPE_CHECKING

from palpate import Command, ReportSection, plugin

if TYPE_CHECKING:
    from palpate import Trajectory

PALPATE_API = 1


@plugin
def palpate_trajectories() -> dict[str, type[Trajectory] | str]:
    """By name."""
    return {"stairs": "palpate_stairs.motion:Stairs"}


@plugin
def palpate_commands() -> dict[str, Command]:
    """By name."""
    return {"stairs": Command("palpate_stairs.command:stairs", "Stiffness of runs of a staircase.")}


@plugin
def palpate_report_sections() -> dict[str, ReportSection]:
    """By name."""
    return {"stairs": ReportSection("palpate_stairs.command:section")}
