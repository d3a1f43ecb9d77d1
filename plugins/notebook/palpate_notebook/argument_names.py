"""Arguments that a function of the Python face does not have: an error that says what to write."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable
from typing import ParamSpec, TypeVar

from palpate import ConfigurationError, suggest
from palpate_engine import RigFacts, question_of

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


def explains_arguments(function: Callable[P, T]) -> Callable[P, T]:
    """Return the function with a ConfigurationError in place of a TypeError for arguments that do not fit it."""
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
        return function(*arguments, **named)

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
