"""palpate: elasticity and viscosity of soft material from robotic palpation, each with its uncertainty.

The public names stand in ``__init__.pyi``; importing palpate imports none of them.
"""

from importlib.util import find_spec

import lazy_loader

_public, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)


def __getattr__(name: str) -> object:
    """Return a public name, imported when it is first used; AttributeError names similar ones."""
    if name.startswith("_") or name in __all__:
        return _public(name)
    try:
        return _public(name)
    except AttributeError as error:
        if find_spec(f"{__name__}.{name}"):  # a module, which `from palpate import MODULE` looks for in the next place
            raise
        from palpate.errors import suggest

        raise AttributeError(f"palpate has no {name!r}{suggest(name, __all__)}") from error
