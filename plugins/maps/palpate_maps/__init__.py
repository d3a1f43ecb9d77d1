"""Maps: from estimates along a way to a map with uncertainty, the lumps in it, and where to look next."""

from palpate import Command, Summary, plugin


@plugin
def palpate_commands() -> dict[str, Command]:
    """Maps, curves, agreement, lumps, sites and search."""
    where = "palpate_maps.commands"
    return {
        "map": Command(f"{where}.map_command:map_run", "Map the stiffness of a run, with its uncertainty."),
        "map curves": Command(f"{where}.curves_command:curves", "Draw runs along a line side by side."),
        "map lumps": Command(f"{where}.lumps_command:lumps", "Find the lumps in a run, with p-values."),
        "map agree": Command(f"{where}.agree_command:agree", "Compare repeated lines or rasters, place by place."),
        "map compare": Command(f"{where}.lumps_command:compare", "Test a suspect site against others."),
        "map search": Command(f"{where}.search_command:search", "Propose where to palpate next, or go there."),
    }


@plugin
def palpate_offers() -> dict[str, dict[str, Summary]]:
    """Values of a sweep are means over its places."""
    return {"summary": {"places": Summary("palpate_maps.path_estimates:Places")}}
