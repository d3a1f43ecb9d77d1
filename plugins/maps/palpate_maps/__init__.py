"""Maps: from estimates along a way to a map with uncertainty, the lumps in it, and where to look next."""

from palpate import Command, Summary, plugin


@plugin
def palpate_commands() -> dict[str, Command]:
    """Maps, curves, lumps, sites and search."""
    return {
        "map": Command("palpate_maps.commands.map:map_run", "Make the map of a run, with its uncertainty."),
        "curves": Command("palpate_maps.commands.curves:curves", "Draw runs along a line side by side."),
        "lumps": Command("palpate_maps.commands.lumps:lumps", "Find the lumps in a run, with p-values."),
        "compare-sites": Command("palpate_maps.commands.lumps:compare", "Test a suspect site against others."),
        "search": Command("palpate_maps.commands.search:search", "Propose where to palpate next, or go there."),
    }


@plugin
def palpate_summaries() -> dict[str, Summary]:
    """Values of a sweep are means over its places."""
    return {"places": Summary("palpate_maps.way:Places")}
