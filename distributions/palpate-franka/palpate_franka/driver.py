"""The driver of a Franka: a Cartesian impedance in the client library's own thread, which palpate leads."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from palpate import DeviceError, Floats, clock
from palpate_arms.arm_driver import KINEMATICS_TOLERANCE, ArmDriver, ArmFaultError, ArmReading
from palpate_kit.kinematics.arm_model import ArmModel
from palpate_kit.kinematics.rotations import matrix_of, pose_of

from palpate_franka.client import connected, reservation, words_of
from palpate_franka.robot_states import complaint, error_bits, error_names, explained, names_of

_ROBOT = re.compile(r'<robot[^>]*\bname="([^"]*)"')
# Choices.
_FRICTION_SPEED = 0.01  # [rad/s] of a joint, from which on all of its friction is compensated
_POSTURE_STIFFNESS = 10.0  # [N m/rad] that holds the elbow
# Times [s] of a stop: until damping alone acts, of the whole stop at most, and until it is given up.
_RAMP_TIME, _MAX_STOP_TIME, _ANSWER_TIME = 0.03, 0.1, 0.15
_ERROR_NAMES = re.compile(r'"(\w+)"')


class FrankaDriver(ArmDriver):
    """States by `Robot.state`, commands by the reference of a `CartesianImpedanceTrackingMotion`.

    The library's thread answers the controller at 1 kHz and holds the latest reference: the controller stops by itself,
    by a reflex, where the process ends, and not where only palpate's loop does.
    """

    def __init__(self, settings: Mapping[str, Any], model: ArmModel | None, tool: Floats) -> None:
        super().__init__(settings, model, tool)
        self._observed = False
        self._motion: Any = None  # by which the arm is held
        self._stops = False
        self._newest: Any = None  # latest of the states that a thread listens to
        self._lost: str | None = None  # reason why states can no longer come

    @property
    def reservation(self) -> str:
        """Name of the controller's port."""
        return reservation(self.settings["host"])

    def connect(self, observe: bool) -> None:
        """Connect; unless the arm is only observed, set tool, load and thresholds, and hold it.

        Raises DeviceError for another robot than the stated one, and for an arm that is not ready.
        """
        import franky

        self._library, self._observed = franky, observe
        self._robot = connected(self.settings["host"], self.settings["realtime"])
        self._errors = error_names(franky)
        state = self._robot.state
        self.facts["robot"] = self._refuse_other_robot()
        self.facts["tcp_in_desk"] = pose_of(state.F_T_NE.matrix)
        self._refuse_other_flange(state)
        if observe:
            clock().thread(self._listen, "franka is observed").start()
            return
        errors = self._named(state.current_errors)
        reason = complaint(int(state.robot_mode), errors)
        if reason is not None:
            raise DeviceError(reason + self._recovery(errors))
        try:
            self._set_up(state)
            self._hold()
        except franky.Exception as error:
            raise DeviceError(f"it takes no settings: {words_of(error)}") from error

    def _listen(self) -> None:
        """Take the states of an arm that is not held, each up to a millisecond, for which the loop does not wait."""
        try:
            while True:
                self._newest = self._robot.state
        except self._library.Exception as error:
            self._lost = words_of(error)

    def _refuse_other_robot(self) -> str:
        """Return the robot's name in its description; raises DeviceError where that is another one."""
        match = _ROBOT.search(self._robot.model_urdf)
        name = match.group(1) if match else "unknown"
        if not name.startswith(self.settings["model"]):
            raise DeviceError(f'it calls itself "{name}", and [device.*] model is "{self.settings["model"]}"')
        return name

    def _set_up(self, state: Any) -> None:
        """Set the tool, the controller's thresholds and, where it is stated, the payload.

        The controller takes matrices by columns, and the tool from its nominal end effector (NE), not from the flange.
        """
        settings = self.settings
        flange_from_nominal = np.linalg.inv(state.F_T_NE.matrix)
        self._robot.set_ee((flange_from_nominal @ self.tool).ravel(order="F").tolist())
        self._robot.set_collision_behavior(settings["collision_torque"], settings["collision_force"])
        if settings["payload"] is not None:
            inertia = np.diag(settings["payload_inertia"]).ravel(order="F").tolist()
            self._robot.set_load(settings["payload"], list(settings["payload_centre"]), inertia)
        self.facts |= {"tcp": pose_of(self.tool), "client": "franky-control"}
        self.facts |= {key: settings[key] for key in ("collision_force", "collision_torque")}

    def _refuse_other_flange(self, state: Any) -> None:
        """Raise DeviceError where the flange is not where the joints put it."""
        assert self.model is not None
        flange = state.O_T_EE.matrix @ np.linalg.inv(state.F_T_EE.matrix)
        model_flange, *_ = self.model.flange(state.q.tolist())
        distance = float(np.linalg.norm((flange - model_flange)[:3, 3]))
        if distance > KINEMATICS_TOLERANCE:
            raise DeviceError(
                f"its flange is {1e3 * distance:.1f} mm from where the joints of a {self.model.name} put it"
            )

    def _hold(self) -> None:
        """Hold the arm where it is, by the impedance."""
        library, settings, state = self._library, self.settings, self._robot.state
        assert self.model is not None
        motion = library.CartesianImpedanceTrackingMotion(
            translational_stiffness=settings["stiffness"],
            rotational_stiffness=settings["rotational_stiffness"],
            translational_error_clip=np.full(3, settings["tracking"]),
            posture_task=library.PostureTask(state.q, _POSTURE_STIFFNESS),
            friction=library.FrictionCompensationParams(coulomb=settings["friction"], velocity_epsilon=_FRICTION_SPEED),
            lower_joint_limits=np.array(self.model.low),
            upper_joint_limits=np.array(self.model.high),
        )
        motion.set_reference(library.CartesianReference(target=state.O_T_EE))
        self._robot.move(motion, asynchronous=True)
        self._motion = motion

    def identify(self, reading: ArmReading) -> None:
        """Record tip and load by the first state; raises DeviceError, with the arm no longer held."""
        try:
            super().identify(reading)
        except DeviceError:
            self.stop()
            raise
        state = self._robot.state
        self.facts |= {"payload": state.m_total, "payload_centre": state.F_x_Ctotal.tolist()}

    def read(self) -> ArmReading | None:
        """Return the newest state: at once where the arm is held or observed, else within a millisecond."""
        try:
            state = self._newest if self._observed else self._robot.state
        except self._library.Exception as error:
            self._lost = words_of(error)
        if self._lost is not None:
            raise ArmFaultError(f"the link to the controller is lost: {self._lost}")
        if state is None:
            return None
        bits = error_bits(state.current_errors, self._errors)
        return ArmReading(
            state.time.to_sec(),
            state.q.tolist(),
            state.dq.tolist(),
            None if self._observed else pose_of(state.O_T_EE.matrix),
            None,  # the velocity follows from the joints: the controller's own is the desired one
            state.O_F_ext_hat_K.tolist(),
            (float(int(state.robot_mode)), float(bits), state.control_command_success_rate),
        )

    def send(self, pose: Sequence[float]) -> bool:
        """Send a pose as the reference of the impedance; return True."""
        library = self._library
        self._motion.set_reference(library.CartesianReference(target=library.Affine(matrix_of(list(pose)))))
        return True

    def stop(self) -> None:
        """Stop the arm by damping alone, at whose end the controller holds it; else by the controller itself."""
        if self._motion is None or self._stops:
            return
        self._stops, library = True, self._library
        if not self._robot.is_in_control:
            return  # the controller has stopped it
        stop_motion = library.TorqueStopMotion(ramp_duration=_RAMP_TIME, max_duration=_MAX_STOP_TIME)
        self._robot.move(stop_motion, asynchronous=True)
        try:
            if not self._robot.join_motion(_ANSWER_TIME):
                self._robot.stop()
        except library.ControlException:  # a reflex, which stops it as well
            return

    def check(self, reading: ArmReading) -> None:
        """Raise ArmFaultError by the controller's mode and errors, and where it takes no more commands."""
        mode, bits = int(reading.status[0]), int(reading.status[1])
        errors = names_of(bits, self._errors)
        reason = complaint(mode, errors)
        if reason is not None:
            raise ArmFaultError(reason + self._recovery(errors))
        if self._motion is not None and not self._stops and not self._robot.is_in_control:
            raise ArmFaultError(self._end())

    def _end(self) -> str:
        """Return why the controller has ended the motion, in its own words."""
        try:
            self._robot.join_motion(0.0)
        except self._library.ControlException as error:
            errors = _ERROR_NAMES.findall(str(error))
            names = f": {explained(errors)}" if errors else ""
            return f"the controller ended the motion ({words_of(error)}){names}{self._recovery(errors)}"
        except self._library.Exception as error:
            return f"the link to the controller is lost: {words_of(error)}"
        return "the controller ended the motion without a reason"

    def _named(self, errors: Any) -> list[str]:
        return names_of(error_bits(errors, self._errors), self._errors)

    def _recovery(self, errors: Sequence[str]) -> str:
        if not errors:
            return ""
        return f". Free the arm, then recover it: palpate franka-recover {self.settings['host']}"
