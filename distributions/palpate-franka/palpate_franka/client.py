"""The client library's connection, with its errors in words for the person at the robot."""

from __future__ import annotations

from typing import Any

from palpate import DeviceError
from palpate_kit.acquisition.device_lock import network_device

_PORT = 1337  # of the controller's commands (Franka Control Interface)
_LOOPBACK = "127."  # of addresses of this computer, where no controller is


def connected(host: str, realtime: str) -> Any:
    """Return a `franky.Robot` at a host; raises DeviceError, and ImportError without the library.

    `realtime` is "enforce" or "ignore": whether a kernel for real time is required.
    """
    import franky

    config = franky.RealtimeConfig.Enforce if realtime == "enforce" else franky.RealtimeConfig.Ignore
    try:
        return franky.Robot(host, realtime_config=config)
    except franky.IncompatibleVersionException as error:
        raise DeviceError(
            f"{words_of(error)}: its system software and the client library do not fit; franky-control has builds for "
            "each version, and a Panda needs one for libfranka 0.9"
        ) from error
    except franky.RealtimeException as error:
        raise DeviceError(
            f'{words_of(error)}: an arm needs a kernel for real time; realtime = "ignore" is for a simulator'
        ) from error
    except franky.Exception as error:
        if host.startswith(_LOOPBACK):
            raise DeviceError(
                f"no simulator is ready at {host}: start it by `palpate twin FILE` in another terminal, and let no "
                f"other program use it ({words_of(error)})"
            ) from error
        raise DeviceError(
            f"{words_of(error)}: is it switched on, are its joints unlocked and is FCI activated in Desk, and does no "
            "other program use it?"
        ) from error


def reservation(host: str) -> str:
    """Return the name of the controller's port, which no two programs on this computer may use at once."""
    return network_device(host, _PORT)


def words_of(error: BaseException) -> str:
    """Return an error of the library as a sentence."""
    return " ".join(str(error).removeprefix("libfranka: ").split()).rstrip(".!")
