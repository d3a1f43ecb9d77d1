"""Watch over this program, which must come to look at the batches of each device in time."""

from __future__ import annotations

from collections.abc import Callable, Iterable

from palpate.clocks import Event, clock

_LOOK_EVERY = 0.02  # [s]; a tenth or less of what `held_up` usually is: a choice


class HostWatch:
    """A thread that looks whether the others do: one that is held up cannot notice it by itself."""

    def __init__(self, limit: float | None, over: Event, trip: Callable[[str], None]) -> None:
        self._limit, self._over, self._trip = limit, over, trip  # [s]
        self._looked: dict[str, float] = {}  # by device: when its batches were last asked for, monotonic [s]
        self._thread = clock().thread(self._watch, "guard", urgent=True)

    @property
    def is_watching(self) -> bool:
        """True if it has been started."""
        return self._thread.ident is not None

    def expect(self, devices: Iterable[str]) -> None:
        """Demand that batches of these devices are looked at from now on, and of no others."""
        now = clock().now()
        self._looked = dict.fromkeys(devices, now)

    def start(self) -> None:
        """Start the thread."""
        self._thread.start()

    def join(self) -> None:
        """Wait for the thread, once it is over."""
        if self._thread.ident is not None:
            self._thread.join()

    def has_looked(self, device: str) -> bool:
        """Note that batches of a device are looked at now; return True if the device is one that is watched."""
        if device not in self._looked:
            return False
        self._looked[device] = clock().now()
        return True

    def forget(self, device: str) -> None:
        """Expect no more batches of a device, which has sent its last one."""
        self._looked.pop(device, None)

    def _watch(self) -> None:
        """Trip the guard where a device has not been looked at for longer than the limit, until the watch is over."""
        while not self._over.wait(_LOOK_EVERY):
            if self._limit is None:
                continue
            for device, last_look in list(self._looked.items()):
                if (late := clock().now() - last_look) > self._limit:
                    cause = clock().late_computer() or "; is the computer too busy?"
                    self._trip(
                        f"this program was held up: it has not come to look at {device} for {1e3 * late:.0f} ms, more "
                        f"than [safety] held_up = {1e3 * self._limit:.0f} ms{cause}"
                    )
