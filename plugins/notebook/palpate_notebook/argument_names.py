"""Arguments of the Python interface: errors and screens name them in place of options of a command."""

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
_SUGGESTIONS = {  # by other names of arguments
    "depth": "height=-depth: a height counts out of the material",
    "position": "height=, which counts out of the material",
    "indentation": "height=-indentation: a height counts out of the material",
    "z": "height=z, which counts out of the material",
    "t": "time=t",
    "f": "force=f",
    "sampling_rate": 'rate="500 Hz"',
    "radius": 'tip="sphere 5 mm", by its radius',
}
# Options and commands in messages of the command line.
_SIGNAL = re.compile(r"--(force|position|time|rate)\b(?: (TOPIC:FIELD|'[^']*'))?")
_FOLDER = re.compile(r"palpate fit (\S+) --tip '([^']*)'")


def in_python(text: str) -> str:
    """Return a text of the command line with arguments of Python in place of its options.

    >>> in_python("choose with --force; state it with --thickness VALUE")
    'choose with signals={"force": "..."}; state it with rig={"thickness": "VALUE"}'
    >>> in_python("all of them: palpate fit curves --tip 'sphere 3 mm'")
    'all of them: palpate.fit_folder("curves", tip="sphere 3 mm")'
    """
    for key in RigFacts.model_fields:
        text = text.replace(f"{option_of(key)} VALUE", f'rig={{"{key}": "VALUE"}}')
    text = _SIGNAL.sub(_signal_argument, text)
    return _FOLDER.sub(r'palpate.fit_folder("\1", tip="\2")', text)


def _signal_argument(match: re.Match[str]) -> str:
    """Return the argument for a match of `_SIGNAL`: role, and value in quotes if the option has one."""
    role, option_value = match[1], match[2] or "..."
    unquoted = option_value.strip("'")
    return f'signals={{"{role}": "{unquoted}"}}'


def explains_arguments(function: Callable[P, T]) -> Callable[P, T]:
    """Return the function, which raises ConfigurationError in place of TypeError for arguments that do not fit.

    Errors of the function itself name arguments in place of options.
    """
    signature = inspect.signature(function)

    @functools.wraps(function)
    def checked(*arguments: P.args, **named: P.kwargs) -> T:
        # Arguments that do not fit: an unknown name, or others that Python names.
        for name in named:
            if name not in signature.parameters:
                raise ConfigurationError(f"{function.__name__}: no argument {name}={_advice(name, signature)}")
        try:
            signature.bind(*arguments, **named)
        except TypeError as error:
            raise ConfigurationError(
                f"{function.__name__}: {error}; write {_call(function.__name__, signature)}"
            ) from error
        # Errors of the function with arguments in place of options.
        try:
            return function(*arguments, **named)
        except UserError as error:
            message = in_python(str(error))
            if message == str(error):
                raise
            raise type(error)(message) from error

    return checked


def _advice(name: str, signature: inspect.Signature) -> str:
    """Return a clause on what to write in place of an unknown argument, from "; write" on."""
    if name in RigFacts.model_fields and "rig" in signature.parameters:
        return f'; write rig={{"{name}": "{question_of(name)[1] or "..."}"}}'
    suggestion = _SUGGESTIONS.get(name, "")
    if suggestion and suggestion.partition("=")[0] in signature.parameters:
        return f"; write {suggestion}"
    return suggest(name, signature.parameters)


def _call(name: str, signature: inspect.Signature) -> str:
    """Return a call of a function with the arguments that have no default."""
    arguments = []
    for parameter in signature.parameters.values():
        if parameter.default is parameter.empty:
            is_keyword = parameter.kind is parameter.KEYWORD_ONLY
            arguments.append(f"{parameter.name}=..." if is_keyword else parameter.name)
    return f"{name}({', '.join(arguments)})"
