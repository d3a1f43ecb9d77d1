"""The face for what uses pipelines: load one, run it, read its run folder, run an analysis of another plugin by name.

Parts need `palpate` only; commands and other tools use `palpate` and this. The names stand in ``host.pyi``.
"""

from palpate.extensions import stubbed

__getattr__ = stubbed(__name__, __file__)
