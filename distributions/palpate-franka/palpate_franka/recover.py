"""``palpate franka-recover``: the recovery from a reflex, by a person's command alone."""

from __future__ import annotations

from typing import Annotated

import typer
from palpate import DeviceError, UserError, clock
from palpate_kit.acquisition.computer import host

from palpate_franka.client import connected, reservation, words_of
from palpate_franka.robot_states import MODES, error_bits, error_names, explained, names_of

_SETTLING_TIME = 1.0  # [s], a choice: until states show the controller's answer
_POLL_INTERVAL = 0.01  # [s] between two looks at the states, a choice


def recover(
    address: Annotated[str, typer.Argument(help="Address of the controller.")],
    realtime: Annotated[bool, typer.Option(help="Ask for a kernel for real time, as a run does.")] = True,
) -> None:
    """Say what stopped a Franka, ask the person at it, and let its controller recover; nothing is moved."""
    try:
        import franky
    except ImportError as error:
        raise UserError(
            f"franky-control is not installed here ({error}): pip install 'palpate-franka[robot]'"
        ) from error
    host().reserve(f"robot {reservation(address)}")
    robot = connected(address, "enforce" if realtime else "ignore")
    state, names = robot.state, error_names(franky)
    errors = names_of(error_bits(state.current_errors, names), names)
    reason = names_of(error_bits(state.last_motion_errors, names), names)
    typer.echo(f"mode: {MODES.get(int(state.robot_mode), state.robot_mode)}")
    typer.echo(f"errors: {explained(errors) or 'none'}")
    if reason:
        typer.echo(f"the last motion ended by: {explained(reason)}")
    if not typer.confirm("Is the arm free, and nobody within its reach?"):
        raise UserError("not recovered")
    try:
        recovered = robot.recover_from_errors()
        # The first states may be older than the recovery.
        deadline = clock().now() + _SETTLING_TIME
        while not recovered and clock().now() < deadline:
            clock().sleep(_POLL_INTERVAL)
            recovered = not robot.has_errors
    except franky.Exception as error:
        raise DeviceError(f"franka at {address}: not recovered: {words_of(error)}") from error
    if not recovered:
        raise DeviceError(f"franka at {address}: not recovered: see Desk")
    typer.echo("recovered")
