"""``palpate init completion``: commands, their options, and names of parts, as a shell completes them."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Annotated

import typer
from palpate import ConfigurationError, suggest
from palpate_engine import function_of, registry

_BASH = """# palpate in bash: eval "$(palpate init completion bash)" in ~/.bashrc; zsh: palpate init completion zsh
_palpate() {{
  local word=${{COMP_WORDS[COMP_CWORD]}} choices=
  if [ "$COMP_CWORD" -eq 1 ]; then
    choices="{commands}"
  else
    local called=${{COMP_WORDS[1]}}
    [ "$COMP_CWORD" -gt 2 ] && case "$called ${{COMP_WORDS[2]}}" in
      {subcommands}) called+=" ${{COMP_WORDS[2]}}" ;;
    esac
    case $called in
{cases}
    esac
  fi
  COMPREPLY=($(compgen -W "$choices" -- "$word"))
}}
complete -o bashdefault -o default -F _palpate palpate
"""
_ZSH = "autoload -Uz compinit bashcompinit && compinit && bashcompinit\n"
_SHELLS = ("bash", "zsh", "fish")


def completion(shell: Annotated[str, typer.Argument(metavar="SHELL", help="bash, zsh or fish.")]) -> None:
    """Print a script that completes commands, options and parts: eval "$(palpate init completion bash)"."""
    if shell not in _SHELLS:
        raise ConfigurationError(f"no completion for {shell!r}{suggest(shell, _SHELLS)}")
    options = {name: options_of(name) for name in registry.load_commands().commands}
    parts = registry.load()
    part_names = sorted({name for entries in parts.parts.values() for name in entries} | set(parts.flags))
    arguments = {"describe": part_names, "init completion": list(_SHELLS), "init": sorted(parts.templates)}
    for name in options:
        first, _, second = name.partition(" ")
        if second:
            arguments.setdefault(first, []).append(second)
    if shell == "fish":
        typer.echo(_fish(options, arguments))
    else:
        typer.echo(_bash(options, arguments, _ZSH if shell == "zsh" else ""))


def options_of(name: str) -> dict[str, str]:
    """Return the long options of a command, each with its help."""
    app = typer.Typer(add_completion=False)
    app.command(name=name)(function_of(registry.load_commands().command(name)))
    command = typer.main.get_command(app)
    help_texts = {"--help": "Show what the command does."}
    for parameter in command.params:
        for option in parameter.opts:
            if option.startswith("--"):
                help_texts[option] = getattr(parameter, "help", None) or ""
    return help_texts


def _bash(options: dict[str, dict[str, str]], arguments: dict[str, list[str]], head: str) -> str:
    """Return the script for bash: after each command its options and arguments."""
    cases = "\n".join(
        f'      "{name}") choices="{" ".join([*options.get(name, ()), *arguments.get(name, ())])}" ;;'
        for name in dict.fromkeys([*options, *arguments])
    )
    subcommands = " | ".join(f'"{name}"' for name in options if " " in name)
    return head + _BASH.format(commands=" ".join(_first_words(options)), subcommands=subcommands, cases=cases)


def _fish(options: dict[str, dict[str, str]], arguments: dict[str, list[str]]) -> str:
    """Return the script for fish: after each command its options, with their help, and arguments."""
    lines = ["# palpate in fish: palpate init completion fish > ~/.config/fish/completions/palpate.fish"]
    lines.append(f"complete -c palpate -n __fish_use_subcommand -f -a '{' '.join(_first_words(options))}'")
    for name in dict.fromkeys([*options, *arguments]):
        condition = " && ".join(f"__fish_seen_subcommand_from {command}" for command in name.split())
        head = f"complete -c palpate -n '{condition}'"
        lines += [f"{head} -l {option[2:]} -d {_quoted(text)}" for option, text in options.get(name, {}).items()]
        if name in arguments:
            lines.append(f"{head} -f -a '{' '.join(arguments[name])}'")
    return "\n".join(lines) + "\n"


def _first_words(names: Iterable[str]) -> list[str]:
    return list(dict.fromkeys(name.partition(" ")[0] for name in names))


def _quoted(text: str) -> str:
    plain = text.replace("\\", "\\\\").replace("'", "\\'").splitlines()
    return f"'{plain[0] if plain else ''}'"
