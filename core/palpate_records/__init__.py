"""A columnar reader of MCAP files, rosbag2 bags, CDR, protobuf and JSON messages, and of tables as text.

The public names stand in ``__init__.pyi``; importing palpate_records imports none of them.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
