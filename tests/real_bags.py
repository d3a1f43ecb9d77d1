"""The authors' gzipped rosbag2 databases as tests read them: unpacked into a folder, and a pipeline file beside."""

import gzip

PIPELINE = """
[device.log]
type = "rosbag2-replay"
file = "log.db3"
time = {{ field = "data", index = 0, unit = "s" }}
signals.z = {{ topic = "/data_control", field = "data", index = {height}, unit = "m" }}
signals.v = {{ topic = "/data_control", field = "data", index = 4, unit = "m/s" }}
signals.f = {{ topic = "/data_control", field = "data", index = 5, unit = "N" }}
[alignment]
force = {{ channel = "log.data_control.f", sign = -1 }}
position = "log.data_control.z"
velocity = "log.data_control.v"
tare_duration = "0.2 s"
{mass}
[indenter.tip]
type = "sphere"
radius = "{radius}"
[model.m]
type = "{model}"
indenter = "tip"
[estimator.e]
type = "{estimator}"
"""


def unpack(bag, database):
    """Write a gzipped database unpacked to a file."""
    database.write_bytes(gzip.decompress(bag.read_bytes()))


def pipeline_of(bag, folder, *, height, radius, model, estimator, mass=""):
    """A pipeline file (its only track m/e) that reads a bag, whose column `height` of /data_control is the position."""
    unpack(bag, folder / "log.db3")
    path = folder / "p.toml"
    path.write_text(PIPELINE.format(height=height, radius=radius, model=model, estimator=estimator, mass=mass))
    return path
