"""franky-sim's arm over palpate's specimen, with palpate's SensONE at the flange, at the time of the wall clock."""

from __future__ import annotations

import json
import signal
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import mujoco
import numpy as np
from franky_sim import SimulationServer
from franky_sim.mujoco_simulator import MujocoSimulator
from palpate import ConfigurationError, DeviceError, Floats, clock
from palpate_kit.acquisition.computer import host, real_time
from palpate_kit.kinematics.arm_model import ArmModel
from palpate_kit.kinematics.rotations import matrix_of, rotation_matrix
from palpate_simulation.sensor_wrench import sensed_wrench
from palpate_simulation.skin_contact import SkinContact
from palpate_simulation.tool_axes import mounting_matrix
from palpate_simulation.twins.console import Console
from palpate_simulation.twins.sensone import VirtualSensor
from palpate_simulation.twins.sensor_lines import PseudoTerminal
from palpate_simulation.twins.settings import BenchSettings

from palpate_franka.models import MODELS, POSTURE
from palpate_franka.simulator.arm_record import ArmRecord
from palpate_franka.simulator.controller_modes import enter_mode, install_recovery
from palpate_franka.simulator.hand import Hand
from palpate_franka.simulator.light_server import lighten

STEP = 1e-3  # [s] of the controller
# [s] from one contact force to the next, which acts meanwhile: a choice, so that the simulator keeps pace
CONTACT_INTERVAL = 2 * STEP
STEPS_A_READ = 5  # steps from one look at the console to the next, a choice
FLANGE = "robot0_hand"  # MuJoCo's body at the flange
HAND_TURN = matrix_of([0.0, 0.0, 0.0, 0.0, 0.0, np.pi / 4])  # from that body to the flange
REACH = 0.5  # [m] from a joint to the tip, a choice: its encoder's noise is that of the measured height over this
AIR_HEIGHT = 3e-3  # [m] over the work frame, a choice: above, nothing touches
MAX_HOLD_UP = 0.5  # [s], a choice: a longer one is not made up for
PAUSE = 1e-4  # [s] that a process at real-time priority sleeps at times, or the system ends it
COMMANDS = {
    "truth": "what the arm did since the last mark, in SI, as JSON",
    "mark": "forget what it did so far",
    "silent": "the controller sends and takes nothing more, and holds the arm",
    "mode NAME ERRORS": "the controller ends the motion with a mode, such as `mode kReflex 7`, until a recovery",
    "lead X Y Z A B C": "a hand leads the tip to a place [mm], its tool turned by a vector [deg]",
    "unplug": "the sensor's cable is pulled",
    "restore": "the cable is put back, the controller sends again, and a hand leads the tip to where it began",
    "quit": "end",
}


class SimulatedRig:
    """Arm, specimen and sensor in MuJoCo's time, which keeps pace with that of the wall."""

    def __init__(self, bench: BenchSettings, model: ArmModel, joints: Sequence[float], seed: int) -> None:
        """Start the simulator with the arm at joints (7,) [rad], its server and the sensor; raises DeviceError."""
        self._bench, self._model, self._sim = bench, model, MujocoSimulator()
        self._sim.init()
        # The simulator's own tool weighs what its model of the robot knows of; its fingers would be in the specimen.
        self._robot = self._sim.add_robot(initial_q=joints)
        for geom in [g for body in self._sim.worldbody.iter("body") for g in body.iter("geom")]:
            geom.set("contype", "0")
            geom.set("conaffinity", "0")
        self._server = SimulationServer(self._sim, [bench.host])
        try:
            self._server.init()
        except OSError as error:
            raise DeviceError(f"{bench.host}: the simulator cannot listen there: {error}") from error
        (self._control,) = self._server.robot_servers
        lighten(self._robot, bench.position_std / REACH, seed)
        install_recovery()
        self._body = mujoco.mj_name2id(self._sim.model, mujoco.mjtObj.mjOBJ_BODY, FLANGE)
        self._tool = HAND_TURN @ matrix_of([*bench.tcp, *bench.tcp_rotation])
        self._inwards, self._origin = bench.work.matrix[:3, :3].T, bench.work.matrix[:3, 3]
        self._mounting = mounting_matrix(bench.mounting)
        self._contact, self._random = SkinContact(), np.random.default_rng(seed)
        self._sensor = VirtualSensor(
            PseudoTerminal(bench.port), bench.line_time, bench.sensor_ppm, bench.clock_start, seed
        )
        self.record = ArmRecord(self._inwards @ bench.work.tool)
        self._now, self._late, self._began = 0.0, 0.0, 0.0  # [s] simulated, largest hold-up, of the wall clock
        self._before: tuple[Floats, Floats] | None = None  # place [m] and velocity [m/s] at the last contact force
        self._felt = np.zeros((2, 3))  # force on the tip [N], and the tip's acceleration [m/s^2], at the last one
        self._is_contact_step = self._done = False
        self._held: Floats | None = None  # joints at which the link was lost
        self._hand = Hand(np.array(joints))

    def end(self, *_: Any) -> None:
        """Let `run` return, also as a handler of signals."""
        self._done = True

    def close(self) -> None:
        """Leave no port behind."""
        self._sensor.unplug()
        self._server.cleanup()

    def _tip(self) -> tuple[Floats, Floats]:
        """Return orientation (3, 3) and place (3,) [m] of the tip in the work frame, at the present joints."""
        data = self._sim.data
        mujoco.mj_kinematics(self._sim.model, data)  # after a step, MuJoCo's bodies are where they were before it
        flange = self._inwards @ data.xmat[self._body].reshape(3, 3)
        place = self._inwards @ (data.xpos[self._body] - self._origin) + flange @ self._tool[:3, 3]
        return flange @ self._tool[:3, :3], place

    def _press(self) -> None:
        """Let the specimen push the arm and the sensor read it, at every other step."""
        self._is_contact_step = not self._is_contact_step
        if not self._is_contact_step:
            return
        # Velocity and acceleration of the tip by differences between contact forces.
        data, (turn, place) = self._sim.data, self._tip()
        place_before, velocity_before = self._before or (place, np.zeros(3))
        velocity = (place - place_before) / CONTACT_INTERVAL
        acceleration, self._before = (velocity - velocity_before) / CONTACT_INTERVAL, (place, velocity)
        push = np.zeros((1, 3))
        if place[2] < AIR_HEIGHT:
            now = np.array([self._now])
            push = self._contact.force(self._bench.specimen, now, place[None], velocity[None])
        joint_speed = float(np.abs(data.qvel[:7]).max())
        self.record.add(place, velocity, push[0], turn, joint_speed, CONTACT_INTERVAL)
        # Force and torque about the body's centre of mass.
        force = self._inwards.T @ push[0]
        lever = self._inwards.T @ place + self._origin - data.xipos[self._body]
        data.xfrc_applied[self._body] = (*force.tolist(), *np.cross(lever, force).tolist())
        self._feel(turn @ self._mounting, np.stack([push[0], acceleration]))

    def _feel(self, axes: Floats, felt: Floats) -> None:
        """Let the sensor read, by its axes (3, 3) in the work frame; between two contact forces by a straight line."""
        self._sensor.poll(self._now)
        instants = self._sensor.instants(self._now)
        felt_before, self._felt = self._felt, felt
        if not len(instants):
            return
        bench, count = self._bench, len(instants)
        share = np.clip((self._now - instants) / CONTACT_INTERVAL, 0.0, 1.0)[:, None]
        push, acceleration = (share * felt_before[row] + (1.0 - share) * felt[row] for row in (0, 1))
        wrench = sensed_wrench(
            push @ axes,
            acceleration @ axes,
            bench.tip_mass,
            bench.bias + bench.drift * instants,
            self._random.standard_normal((count, 6)),
            bench.force_std * self._sensor.noise_factor,
            bench.force_limit,
            (-self._inwards[:, 2] @ axes).tolist(),
        )
        self._sensor.send(instants, wrench)
        clock().sleep(PAUSE)  # the kernel carries the bytes to their reader once this process sleeps

    def truth(self) -> dict[str, object]:
        """Return what MuJoCo's arm did since the mark, and what its controller was sent."""
        mode = self._control.robot_state.robot_mode.name
        return {**self.record.facts(), "mode": mode, "load": self._robot.m_load, "late": self._late}

    def run(self) -> None:
        """Run step by step, each at its time of the wall clock; a short hold-up of the machine is made up for."""
        console = Console(self._answer, COMMANDS)
        self._began = clock().now()
        while not (self._done or console.ended):
            for _ in range(STEPS_A_READ):
                self._step()
                wait = self._began + self._now - clock().now()
                self._late = max(self._late, -wait)
                if wait < -MAX_HOLD_UP:
                    self._began -= wait
                if wait > 0.0:
                    clock().sleep(wait)
            # The next command of the standard input, if there is one.
            console.read(clock().wait(console.inputs, PAUSE))

    def _step(self) -> None:
        """Take the controller's commands, go on by one step, and send a state and readings of the same instant."""
        if self._held is not None:  # a controller without commands holds the arm
            self._robot.joint_position_control(self._held)
        else:
            self._control.process_commands()
            if self._hand.leads:
                self._follow_hand()
        self._sim.step()
        self._now += STEP
        self._press()
        if self._held is None:
            self._control.send_state()

    def _answer(self, command: Sequence[str]) -> str:
        """Carry out a command, and return what the arm did, or which commands there are."""
        try:
            self._obey(*command)
        except (ConfigurationError, IndexError, KeyError, TypeError, ValueError):
            return f"expected one of: {', '.join(COMMANDS)}"
        return json.dumps(self.truth())

    def _obey(self, name: str, *arguments: str) -> None:
        """Carry out a command; raises ValueError or the like for a wrong one."""
        if name == "mark":
            self.record.mark()
        elif name == "silent":
            self._held = self._joints
        elif name == "lead":
            self._lead(*map(float, arguments))
        elif name == "unplug":
            self._sensor.unplug()
        elif name == "restore":
            self._restore()
        elif name == "mode":
            enter_mode(self._control, arguments[0], arguments[1:])
        elif name not in ("truth", "quit"):
            raise ValueError(name)

    def _lead(self, x: float, y: float, z: float, *turn: float) -> None:
        """Let a hand lead the tip to a place [mm] in the work frame, the tool turned from its by a vector [deg]."""
        place = np.array([x, y, z]) / 1e3
        self._lead_to(joints_of(self._bench, self._model, place, self._joints, np.radians(turn).tolist()))

    def _restore(self) -> None:
        """Put cable and link back, and let a hand lead an arm that no program moves to where it began."""
        self._sensor.restore()
        self._held = None
        if not self._control.current_motion_id:
            self._lead_to()

    @property
    def _joints(self) -> Floats:
        return self._sim.data.qpos[:7].copy()

    def _lead_to(self, goal: Floats | None = None) -> None:
        self._hand.lead(self._joints, goal)
        self.record.stands = 0.0

    def _follow_hand(self) -> None:
        """Go a step to where a hand leads the arm; once it lets go, the controller holds the arm there."""
        self._robot.joint_position_control(self._hand.joints_after(STEP))
        if self._hand.let_go(self.record.stands):
            self._control.stop_motion(send_preemption_signal=False)


def joints_of(
    bench: BenchSettings, model: ArmModel, place: Floats, near: Floats, turn: Sequence[float] = (0.0, 0.0, 0.0)
) -> Floats:
    """Return joints (7,) [rad] for a tip at a place (3,) [m] of the work frame, the tool turned by a vector (3,) [rad].

    Raises ConfigurationError where the arm does not reach it.
    """
    pose = bench.work.tool_pose(place)
    pose[:3, :3] = pose[:3, :3] @ rotation_matrix(list(turn))
    joints = model.joints_at(pose, matrix_of([*bench.tcp, *bench.tcp_rotation]), near, steps=200)
    if joints is None:
        raise ConfigurationError("the twin's arm cannot reach the work frame: move [twin.*] work")
    return joints


def serve_rig(bench: BenchSettings, seed: int, ready: Callable[[Mapping[str, str]], None]) -> None:
    """Serve arm and sensor until Ctrl-C, SIGTERM or the end of the standard input; raises DeviceError."""
    model = MODELS["fr3"]
    joints = joints_of(bench, model, np.array([*bench.place, bench.height]), np.array(POSTURE))
    rig = SimulatedRig(bench, model, joints.tolist(), seed)
    scheduling = real_time(40)
    host().run_without_collection()
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, rig.end)
    try:
        ready({"robot": bench.host, "sensor": str(bench.port), "with": scheduling})
        rig.run()
    finally:
        rig.close()
