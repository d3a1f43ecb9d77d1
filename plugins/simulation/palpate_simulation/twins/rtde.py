"""RTDE, the controller's side: packets, types, recipes (UR, "Real-Time Data Exchange guide"). All big-endian."""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator, Mapping
from typing import Any

_CODES = {"DOUBLE": "d", "UINT64": "Q", "UINT32": "I", "INT32": "i", "UINT8": "B", "BOOL": "?"}
_CODES |= {"VECTOR3D": "3d", "VECTOR6D": "6d", "VECTOR6INT32": "6i", "VECTOR6UINT32": "6I"}

_REGISTERS = {
    **{f"input_int_register_{i}": "INT32" for i in range(48)},
    **{f"input_double_register_{i}": "DOUBLE" for i in range(48)},
}
OUTPUTS: dict[str, str] = {
    "timestamp": "DOUBLE",
    **dict.fromkeys(
        [
            "target_q",
            "target_qd",
            "target_qdd",
            "target_current",
            "target_moment",
            "actual_q",
            "actual_qd",
            "actual_current",
            "joint_control_output",
            "actual_TCP_pose",
            "actual_TCP_speed",
            "actual_TCP_force",
            "target_TCP_pose",
            "target_TCP_speed",
            "joint_temperatures",
            "actual_joint_voltage",
            "actual_current_as_torque",
            "ft_raw_wrench",
            "payload_inertia",
        ],
        "VECTOR6D",
    ),
    **dict.fromkeys(
        [
            "actual_tool_accelerometer",
            "payload_cog",
            "elbow_position",
            "elbow_velocity",
        ],
        "VECTOR3D",
    ),
    **dict.fromkeys(
        [
            "actual_execution_time",
            "speed_scaling",
            "target_speed_fraction",
            "actual_momentum",
            "actual_main_voltage",
            "actual_robot_voltage",
            "actual_robot_current",
            "standard_analog_input0",
            "standard_analog_input1",
            "standard_analog_output0",
            "standard_analog_output1",
            "payload",
            "tcp_force_scalar",
        ],
        "DOUBLE",
    ),
    **dict.fromkeys(["actual_digital_input_bits", "actual_digital_output_bits"], "UINT64"),
    **dict.fromkeys(["runtime_state", "robot_status_bits", "safety_status_bits"], "UINT32"),
    **dict.fromkeys(["robot_mode", "safety_mode", "safety_status"], "INT32"),
    "joint_mode": "VECTOR6INT32",
    **{f"output_int_register_{i}": "INT32" for i in range(48)},
    **{f"output_double_register_{i}": "DOUBLE" for i in range(48)},
    **_REGISTERS,  # read back
}
INPUTS: dict[str, str] = {
    **_REGISTERS,
    "external_force_torque": "VECTOR6D",
    "speed_slider_mask": "UINT32",
    "speed_slider_fraction": "DOUBLE",
    **dict.fromkeys(
        [
            "standard_digital_output_mask",
            "configurable_digital_output_mask",
            "tool_digital_output_mask",
            "standard_digital_output",
            "configurable_digital_output",
            "tool_digital_output",
        ],
        "UINT8",
    ),
}


def packet(kind: str, payload: bytes = b"") -> bytes:
    """Return a packet of a type, which is a letter."""
    return struct.pack(">HB", 3 + len(payload), ord(kind)) + payload


def packets(buffer: bytearray) -> Iterator[tuple[str, bytes]]:
    """Take the whole packets out of a buffer; raises ValueError where the size is impossible."""
    while len(buffer) >= 3:
        size, kind = struct.unpack_from(">HB", buffer)
        if size < 3:
            raise ValueError("a packet shorter than its header")
        if len(buffer) < size:
            return
        payload = bytes(buffer[3:size])
        del buffer[:size]
        yield chr(kind), payload


def names_in(payload: bytes) -> list[str]:
    """Return the names of a comma separated list, which may end with a comma."""
    return [name for name in payload.decode("ascii", errors="replace").split(",") if name]


def layout(names: list[str], types: Mapping[str, str]) -> struct.Struct:
    """How the values of a recipe lie in a data packet; unknown names take no room."""
    return struct.Struct(">" + "".join(_CODES[types[name]] for name in names if name in types))


class ClientSession:
    """One client's connection: recipes, and whether it requested data.

    `claim` returns whether an input is this session's to write; `write` takes the inputs of a data packet. An output
    that is `unknown` is not found; START is refused unless `starts`.
    """

    def __init__(
        self,
        version: tuple[int, int, int, int],
        claim: Callable[[ClientSession, str], bool],
        write: Callable[[dict[str, Any]], None],
        unknown: str = "",
        starts: bool = True,
    ) -> None:
        self._version = version
        self._claim = claim
        self._write = write
        self._outputs_known = {name: kind for name, kind in OUTPUTS.items() if name != unknown}
        self._starts = starts
        self._inputs: dict[int, tuple[list[str], struct.Struct]] = {}
        self._outputs: list[str] = []
        self._struct = struct.Struct(">")
        self._every = 1
        self._ticks = 0
        self.started = False

    @property
    def commands(self) -> bool:
        """True if it has inputs to write."""
        return bool(self._inputs)

    def answer(self, kind: str, payload: bytes) -> bytes:
        """Return the controller's answer to a packet."""
        if kind == "V":
            return packet("V", bytes([payload == b"\0\2"]))
        if kind == "v":
            return packet("v", struct.pack(">4I", *self._version))
        if kind == "O":
            return self._set_outputs(payload)
        if kind == "I":
            return self._set_inputs(payload)
        if kind in "SP":
            self.started = kind == "S" and bool(self._outputs) and self._starts
            return packet(kind, bytes([self.started or kind == "P"]))
        if kind == "U" and payload and payload[0] in self._inputs:
            names, form = self._inputs[payload[0]]
            if len(payload) - 1 >= form.size:
                self._write(dict(zip(names, form.unpack_from(payload, 1), strict=False)))
        return b""

    def _set_outputs(self, payload: bytes) -> bytes:
        (frequency,) = struct.unpack_from(">d", payload)
        names = names_in(payload[8:])
        self._every = max(int(500.0 / frequency), 1) if frequency > 0 else 1
        self._outputs = [name for name in names if name in self._outputs_known]
        self._struct = layout(self._outputs, self._outputs_known)
        types = ",".join(self._outputs_known.get(name, "NOT_FOUND") for name in names)
        return packet("O", bytes([1 if len(self._outputs) == len(names) else 0]) + types.encode())

    def _set_inputs(self, payload: bytes) -> bytes:
        names = names_in(payload)
        types = [INPUTS.get(name, "NOT_FOUND") for name in names]
        types = ["IN_USE" if kind != "NOT_FOUND" and not self._claim(self, name) else kind for name, kind in
                 zip(names, types, strict=True)]  # fmt: skip
        good = not {"IN_USE", "NOT_FOUND"} & set(types)
        identity = len(self._inputs) + 1 if good else 0
        if good:
            self._inputs[identity] = names, layout(names, INPUTS)
        return packet("I", bytes([identity]) + ",".join(types).encode())

    def data(self, state: Mapping[str, Any], missing: int = 0) -> bytes:
        """This tick's data packet, `missing` so many bytes; empty where the session does not want one now."""
        self._ticks += 1
        if not self.started or self._ticks % self._every:
            return b""
        values: list[Any] = []
        for name in self._outputs:
            value = state[name]
            if isinstance(value, (int, float)):
                values.append(value)
            else:
                values.extend(value)
        payload = b"\1" + self._struct.pack(*values)
        return packet("U", payload[: max(len(payload) - missing, 1)])
