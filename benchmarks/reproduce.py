"""A paper's tables and figures, recomputed from the authors' recordings and compared with the published numbers.

Run it with: python benchmarks/reproduce.py [NAME...] --data DIR [--out DIR] [--paper DIR]; docs/reproduce.md says how
rows are judged, `reproduction/README.md` how a paper of your own is described.
"""

import sys

import typer
from palpate import PalpateError
from palpate.trust import at_the_command_line
from reproduction.report import reproduce


def main() -> None:
    """The script; exit code 2 for a mistake of the user, 1 where a number is outside its tolerance or not made."""
    try:
        with at_the_command_line(sys.argv[1:]):  # plugin files that a paper names were named by nobody
            typer.run(reproduce)
    except PalpateError as error:
        print(f"reproduce: {error}", file=sys.stderr)
        sys.exit(error.exit_code)


if __name__ == "__main__":
    main()
