"""RTDE, the controller's side: packets, types, recipes (UR, "Real-Time Data Exchange guide"). All big-endian."""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator, Mapping
from typing import Any

CONTROL_RATE = 500.0  # [Hz] of an e-series controller
_HEADER = struct.Struct(">HB")  # size of the whole packet, and its type, a letter
# Formats of `struct` by the type names of RTDE.
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


def packet(letter: str, payload: bytes = b"") -> bytes:
    """Return a packet: its size in two bytes, its type, a letter, in one, and the payload."""
    return _HEADER.pack(_HEADER.size + len(payload), ord(letter)) + payload


def packets(buffer: bytearray) -> Iterator[tuple[str, bytes]]:
    """Remove whole packets from a buffer, and yield type and payload of each; raises ValueError for a wrong size."""
    while len(buffer) >= _HEADER.size:
        size, type_code = _HEADER.unpack_from(buffer)
        if size < _HEADER.size:
            raise ValueError("a packet shorter than its header")
        if len(buffer) < size:
            return
        payload = bytes(buffer[_HEADER.size : size])
        del buffer[:size]
        yield chr(type_code), payload


def names_in(payload: bytes) -> list[str]:
    """Return the names of a comma separated list, which may end with a comma."""
    return [name for name in payload.decode("ascii", errors="replace").split(",") if name]


def layout(names: list[str], types: Mapping[str, str]) -> struct.Struct:
    """Return the layout of a recipe's values in a data packet, one after the other; unknown names take no room."""
    return struct.Struct(">" + "".join(_CODES[types[name]] for name in names if name in types))


class ClientSession:
    """Connection of one client: the recipes of its inputs and outputs, and whether it has requested data.

    `claim` returns True if this session may write an input; `write` takes the inputs of a data packet. An output that
    is `unknown` is not found; START is refused unless `starts`.
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
        self._output_types = {name: OUTPUTS[name] for name in OUTPUTS if name != unknown}
        self._starts = starts
        self._inputs: dict[int, tuple[list[str], struct.Struct]] = {}  # names and layout, by number of the recipe
        self._outputs: list[str] = []  # names of the recipe
        self._output_layout = struct.Struct(">")
        self._ticks_per_packet = 1
        self._ticks = 0  # since the connection began
        self.started = False  # data were requested

    @property
    def commands(self) -> bool:
        """True if the client has inputs to write."""
        return bool(self._inputs)

    def answer(self, letter: str, payload: bytes) -> bytes:
        """Return the controller's answer to a packet; none to a data packet.

        V: is this version of RTDE supported; v: version of the controller; O, I: recipes of outputs and inputs;
        S, P: start and pause of the data; U: data, the number of a recipe and its inputs.
        """
        if letter == "V":
            return packet("V", bytes([payload == b"\0\2"]))
        if letter == "v":
            return packet("v", struct.pack(">4I", *self._version))
        if letter == "O":
            return self._set_outputs(payload)
        if letter == "I":
            return self._set_inputs(payload)
        if letter in "SP":
            self.started = letter == "S" and bool(self._outputs) and self._starts
            return packet(letter, bytes([self.started or letter == "P"]))
        if letter == "U" and payload and payload[0] in self._inputs:
            names, input_layout = self._inputs[payload[0]]
            if len(payload) - 1 >= input_layout.size:
                self._write(dict(zip(names, input_layout.unpack_from(payload, 1), strict=False)))
        return b""

    def _set_outputs(self, payload: bytes) -> bytes:
        """Set the recipe of the outputs: their rate [Hz], a double, and their names. Answer with 1 or 0, and types."""
        (rate,) = struct.unpack_from(">d", payload)
        names = names_in(payload[8:])
        self._ticks_per_packet = max(int(CONTROL_RATE / rate), 1) if rate > 0 else 1
        self._outputs = [name for name in names if name in self._output_types]
        self._output_layout = layout(self._outputs, self._output_types)
        types = ",".join(self._output_types.get(name, "NOT_FOUND") for name in names)
        return packet("O", bytes([len(self._outputs) == len(names)]) + types.encode())

    def _set_inputs(self, payload: bytes) -> bytes:
        """Set a recipe of inputs by their names. Answer with its number, 0 where one is not free, and their types."""
        names = names_in(payload)
        types = [self._claimed_type(name) for name in names]
        is_accepted = not {"IN_USE", "NOT_FOUND"} & set(types)
        recipe = len(self._inputs) + 1 if is_accepted else 0
        if is_accepted:
            self._inputs[recipe] = names, layout(names, INPUTS)
        return packet("I", bytes([recipe]) + ",".join(types).encode())

    def _claimed_type(self, name: str) -> str:
        """Claim an input, and return its type, or the reason for which it cannot be had."""
        if name not in INPUTS:
            return "NOT_FOUND"
        return INPUTS[name] if self._claim(self, name) else "IN_USE"

    def data(self, state: Mapping[str, Any], missing: int = 0) -> bytes:
        """Return this tick's data packet, which lacks its last `missing` bytes; empty in ticks without one."""
        self._ticks += 1
        if not self.started or self._ticks % self._ticks_per_packet:
            return b""
        numbers: list[Any] = []
        for name in self._outputs:
            output = state[name]
            if isinstance(output, (int, float)):
                numbers.append(output)
            else:
                numbers.extend(output)
        payload = b"\1" + self._output_layout.pack(*numbers)
        return packet("U", payload[: max(len(payload) - missing, 1)])
