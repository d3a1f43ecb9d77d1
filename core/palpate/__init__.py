"""palpate: elasticity and viscosity of soft material from robotic palpation, each with its uncertainty.

The public names stand in ``__init__.pyi``; importing palpate imports none of them.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
