"""palpate: elasticity and viscosity of soft material from robotic palpation, each with its uncertainty.

The public names stand in ``__init__.pyi``; importing palpate imports none of them.
"""

from palpate.extensions import stubbed

__getattr__ = stubbed(__name__, __file__)
