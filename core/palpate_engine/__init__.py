"""The engine of one run: load a pipeline, run it, read its result, call an analysis by name.

The public names stand in ``__init__.pyi``; importing palpate_engine imports none of them.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
