"""Former names of keys of robots and sensors."""

from palpate import Migration

RENAMED = (
    *(
        Migration("0.2", "device", robot, {"stale": "controller_timeout", "host_limit": "host_timeout"})
        for robot in ("ur", "ur3e")
    ),
    *(Migration("0.2", "device", sensor, {"silence": "sensor_timeout"}) for sensor in ("bota", "rdt")),
)
