"""Arguments of the Python interface: errors and screens say what to write in Python, and no option of a command."""

from __future__ import annotations

import functools
import inspect
import re
from collections.abc import Callable
from typing import ParamSpec, TypeVar

from palpate import ConfigurationError, UserError, suggest
from palpate_engine import RigFacts, option_of, question_of

P = ParamSpec("P")
T = TypeVar("T")
_MEANT = {  # by arguments that people write
    "depth": "height=-depth: a height counts out of the material",
    "position": "height=, which counts out of the material",
    "indentation": "height=-indentation: a height counts out of the material",
    "z": "height=z, which counts out of the material",
    "t": "time=t",
    "f": "force=f",
    "sampling_rate": 'rate="500 Hz"',
    "radius": 'tip="sphere 5 mm", by its radius',
}


# What the command line says of a log, a fact and a folder.
_SIGNAL = re.compile(r"--(force|position|time|rate)\b(?: (TOPIC:FIELD|'[^']*'))?")
_FOLDER = re.compile(r"palpate fit (\S+) --tip '([^']*)'")


def in_python(text: str) -> str:
    """Return a sentence with arguments of Python in place of options of a command.

    >>> in_python("choose with --force; state it with --thickness VALUE")
    'choose with signals={"force": "..."}; state it with rig={"thickness": "VALUE"}'
    >>> in_python("all of them: palpate fit curves --tip 'sphere 3 mm'")
    'all of them: palpate.fit_folder("curves", tip="sphere 3 mm")'
    """
    for key in RigFacts.model_fields:
        text = text.replace(f"{option_of(key)} VALUE", f'rig={{"{key}": "VALUE"}}')
    text = _SIGNAL.sub(lambda match: f'signals={{"{match[1]}": "{(match[2] or "...").strip(chr(39))}"}}', text)
    return _FOLDER.sub(r'palpate.fit_folder("\1", tip="\2")', text)


def explains_arguments(function: Callable[P, T]) -> Callable[P, T]:
    """Return the function with a ConfigurationError in place of a TypeError for arguments that do not fit it.

    Its own errors have arguments in place of options.
    """
    signature = inspect.signature(function)

    @functools.wraps(function)
    def checked(*arguments: P.args, **named: P.kwargs) -> T:
        for name in named:
            if name not in signature.parameters:
                raise ConfigurationError(f"{function.__name__}: no argument {name}={_advice(name, signature)}")
        try:
            signature.bind(*arguments, **named)
        except TypeError as error:
            raise ConfigurationError(
                f"{function.__name__}: {error}; write {_call(function.__name__, signature)}"
            ) from error
        try:
            return function(*arguments, **named)
        except UserError as error:
            if (words := in_python(str(error))) == str(error):
                raise
            raise type(error)(words) from error

    return checked


def _advice(name: str, signature: inspect.Signature) -> str:
    """Return what to write in place of an argument."""
    if name in RigFacts.model_fields and "rig" in signature.parameters:
        return f'; write rig={{"{name}": "{question_of(name)[1] or "..."}"}}'
    meant = _MEANT.get(name, "")
    if meant and meant.partition("=")[0] in signature.parameters:
        return f"; write {meant}"
    return suggest(name, signature.parameters)


def _call(name: str, signature: inspect.Signature) -> str:
    """Return a call with the arguments that have no default."""
    needed = [f"{one.name}=..." if one.kind is one.KEYWORD_ONLY else one.name for one in signature.parameters.values()
              if one.default is one.empty]  # fmt: skip
    return f"{name}({', '.join(needed)})"
