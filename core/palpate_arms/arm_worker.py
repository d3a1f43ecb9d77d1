"""The process of an arm: its driver, which may hang or crash on a lost link, and the servo loop."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from typing import Any, NoReturn

import numpy as np
from palpate import DeviceError, UserError
from palpate_kit.acquisition.child import Parent
from palpate_kit.acquisition.class_place import class_at
from palpate_kit.acquisition.computer import host
from palpate_kit.acquisition.ring import Ring
from palpate_kit.kinematics.arm_model import ArmModel
from palpate_kit.kinematics.work_frame import WorkFrame

from palpate_arms.arm_driver import ArmDriver, ArmFaultError
from palpate_arms.arm_loop import ArmLoop
from palpate_arms.arm_rows import ArmRows
from palpate_arms.commanded_arm import CommandedArm
from palpate_arms.driver_answer import driver_error

MODULE = "palpate_arms.arm_worker"
_PRIORITY = 45  # a choice: real-time priority of the process, above the threads of the main job that watch it (20)


def main(arguments: Sequence[str]) -> None:
    """Connect, report, servo until the parent goes or the robot fails.

    Arguments: descriptors of the socket to the parent and of the ring, and the task as JSON.
    """
    task, scheduling = json.loads(arguments[2]), host().enter(_PRIORITY)
    with Parent(int(arguments[0])) as parent:
        rows = ArmRows(task["joints"], task["status"])
        _serve(parent, Ring(int(arguments[1]), rows.row.size), rows, task, scheduling)


def _serve(parent: Parent, ring: Ring, rows: ArmRows, task: dict[str, Any], scheduling: str) -> NoReturn:
    """Connect the driver, report that the arm is ready, and servo; report what kept it from that."""
    driver = None
    try:
        driver = _driver(task)
        if not task["observe"]:
            host().reserve(f"robot {driver.reservation}")
        arm = CommandedArm(driver, rows, WorkFrame.model_construct(**task["work"]), task["observe"])
    except (DeviceError, UserError, ArmFaultError) as error:
        parent.tell("fault", text=str(error))
        host().leave(1)
    except ImportError as error:
        parent.tell("fault", text=f"its client library is not installed here ({error})")
        host().leave(1)
    except RuntimeError as error:
        parent.tell("fault", text=f"cannot connect: {' '.join(str(error).split())}")
        host().leave(1)  # its destructors sleep, hang or crash
    except Exception as error:  # whatever a driver raises
        text = driver_error(error, driver) or f"its driver failed: {type(error).__name__}: {error}"
        parent.tell("fault", text=f"cannot connect: {text}")
        host().leave(1)
    # No garbage is collected while the loop runs: that would hold it up.
    host().run_without_collection()
    model = arm.model.model_dump()
    parent.tell("ready", scheduling=scheduling, arm_model=model, tool=arm.tool.ravel().tolist(), **arm.facts)
    ArmLoop(parent, ring, arm, task).run()


def _driver(task: dict[str, Any]) -> ArmDriver:
    """Return the driver of a task, not connected."""
    model = None if task["arm_model"] is None else ArmModel.model_validate(task["arm_model"])
    tool = np.array(task["tool"]).reshape(4, 4)
    driver: ArmDriver = host().arm_driver(class_at(task["driver"]), task["settings"], model, tool)
    return driver


if __name__ == "__main__":
    main(sys.argv[1:])
