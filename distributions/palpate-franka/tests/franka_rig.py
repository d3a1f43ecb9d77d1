"""franky-sim's arm over palpate's specimen, with palpate's SensONE at the flange: a program of its own, for the tests.

Its arguments are a pipeline file and settings. It says `ready ADDRESS` once it serves, and then obeys one word to a
line with what the arm did: `truth`, `mark`, `silent`, `mode NAME ERRORS`, `lead X Y Z A B C`, `quit`.
"""

import json
import math
import select
import sys
from pathlib import Path

import mujoco
import numpy as np
from franky_sim import FrankaRobotServer, SimulationServer
from franky_sim.franka_robot_protocol import (
    AutomaticErrorRecoveryCommand,
    AutomaticErrorRecoveryStatus,
    BaseCommand,
    MoveStatus,
    RobotCommand,
    RobotMode,
)
from franky_sim.mujoco_simulator import MujocoSimulator
from light_simulator import lighten
from palpate import clock
from palpate_engine import load_pipeline
from palpate_kit.acquisition.computer import host
from palpate_kit.kinematics.rotations import matrix_of, rotation_matrix
from palpate_simulation.sensor_wrench import sensed_wrench
from palpate_simulation.skin_contact import SkinContact
from palpate_simulation.tool_axes import mounting_matrix
from palpate_simulation.twins.sensone import VirtualSensor
from palpate_simulation.twins.sensor_lines import PseudoTerminal

STEP = 1e-3  # s
LOOK = 2 * STEP  # [s] from one force to the next, which goes on meanwhile: the simulator has to keep step
BODY = "robot0_hand"  # at the flange, turned by -45 deg
TURN = matrix_of([0.0, 0.0, 0.0, 0.0, 0.0, np.pi / 4])
HIGH = 3e-3  # [m] over the work frame, where nothing is felt
BEHIND = 0.5  # [s] that are not made up for
PAUSE = 1e-4  # [s] that a process at real-time priority has to sleep at times, or the system ends it
STANDS = 1e-3  # [m/s]
PACE = 0.3  # [rad/s] of the joints, where a hand leads the arm


class Rig:
    """Arm, specimen and sensor in MuJoCo's time, which is kept at that of the wall."""

    def __init__(self, bench, model, joints):
        self.bench, self.model, self.sim = bench, model, MujocoSimulator()
        self.sim.init()
        # The simulator's own tool weighs what its model of the robot knows of.
        self.robot = self.sim.add_robot(initial_q=joints)
        # The fingers would be in the specimen's place.
        for geom in [g for body in self.sim.worldbody.iter("body") for g in body.iter("geom")]:
            geom.set("contype", "0")
            geom.set("conaffinity", "0")
        self.server = SimulationServer(self.sim)
        self.server.init()
        (self.control,) = self.server.robot_servers
        lighten(self.robot)
        self.sim.register_pre_step_callback(self.press)
        self.body = mujoco.mj_name2id(self.sim.model, mujoco.mjtObj.mjOBJ_BODY, BODY)
        self.tool = TURN @ matrix_of([*bench.tcp, *bench.tcp_rotation])
        self.inwards, self.origin = bench.work.matrix[:3, :3].T, bench.work.matrix[:3, 3]
        self.nominal = self.inwards @ bench.work.tool
        self.mounting = mounting_matrix(bench.mounting)
        self.contact, self.random = SkinContact(), np.random.default_rng(1)
        self.sensor = VirtualSensor(PseudoTerminal(bench.port), bench.line_time, bench.sensor_ppm, 0, 1)
        self.now, self.before, self.stands = 0.0, None, 0.0
        self.looks, self.pushed = True, np.zeros(3)
        self.held = self.hand = None  # joints: at which its link was lost, to which a hand leads it
        self.mark()

    def mark(self):
        """Forget what the arm did so far."""
        self.low, self.high = np.full(3, np.inf), np.full(3, -np.inf)
        self.fastest = self.force = self.askew = self.fastest_joint = 0.0

    def tip(self):
        """Rotation (3, 3) and place (3,) of the tip in the work frame."""
        data = self.sim.data
        flange = self.inwards @ data.xmat[self.body].reshape(3, 3)
        place = self.inwards @ (data.xpos[self.body] - self.origin) + flange @ self.tool[:3, 3]
        return flange @ self.tool[:3, :3], place

    def press(self, sim):
        """The specimen pushes the arm; the sensor feels it."""
        self.looks = not self.looks
        if self.looks:
            return
        turn, place = self.tip()
        before = self.before or (place, np.zeros(3))
        speed = (place - before[0]) / LOOK
        acceleration, self.before = (speed - before[1]) / LOOK, (place, speed)
        self.look(place, speed, self.pushed, turn)
        push = np.zeros((1, 3))
        if place[2] < HIGH:
            push = self.contact.force(self.bench.specimen, np.array([self.now]), place[None], speed[None])
        force = self.inwards.T @ push[0]
        x, y, z = (self.inwards.T @ place + self.origin - sim.data.xipos[self.body]).tolist()
        a, b, c = force.tolist()
        sim.data.xfrc_applied[self.body] = (a, b, c, y * c - z * b, z * a - x * c, x * b - y * a)
        self.pushed = push[0]
        self.feel(turn @ self.mounting, push, acceleration)

    def look(self, place, speed, push, turn):
        """Note the extremes of what the arm does."""
        self.low, self.high = np.minimum(self.low, place), np.maximum(self.high, place)
        pace = math.hypot(*speed.tolist())
        self.fastest, self.stands = max(self.fastest, pace), self.stands + LOOK if pace < STANDS else 0.0
        self.force = max(self.force, math.hypot(*push.tolist()))
        cosine = (float((self.nominal * turn).sum()) - 1.0) / 2.0
        self.askew = max(self.askew, math.acos(min(cosine, 1.0)))
        self.fastest_joint = max(self.fastest_joint, float(np.abs(self.sim.data.qvel[:7]).max()))

    def feel(self, axes, push, acceleration):
        """Let the sensor read, whose axes (3, 3) are in the work frame."""
        self.sensor.poll(self.now)
        instants = self.sensor.instants(self.now)
        if not len(instants):
            return
        bench, count = self.bench, len(instants)
        noise = self.random.standard_normal((count, 6))
        std = bench.force_std * self.sensor.noise_factor
        wrench = sensed_wrench(
            np.tile(push @ axes, (count, 1)),
            np.tile(acceleration @ axes, (count, 1)),
            bench.tip_mass,
            bench.bias + bench.drift * instants,
            noise,
            std,
            bench.force_limit,
            (-self.inwards[:, 2] @ axes).tolist(),
        )
        self.sensor.send(instants, wrench)

    def truth(self):
        """What MuJoCo's arm did since the mark, and what its controller was sent."""
        robot = self.robot
        return {
            "low": self.low.tolist(),
            "high": self.high.tolist(),
            "fastest": self.fastest,
            "force": self.force,
            "askew": self.askew,
            "fastest_joint": self.fastest_joint,
            "stands": self.stands,
            "place": self.before[0].tolist(),
            "mode": self.control.robot_state.robot_mode.name,
            "load": robot.m_load,
            "late": self.late,
        }

    def run(self):
        """Step by step, each at its time; what the machine holds up is made up for."""
        host().enter(40)
        host().run_without_collection()
        self.began, self.late = clock().now(), 0.0
        while True:
            for _ in range(5):
                if self.held is None:
                    self.control.process_commands()
                    if self.hand is not None:
                        self.follow_hand()
                else:  # a controller without commands holds the arm
                    self.robot.joint_position_control(self.held)
                self.sim.step()
                self.now += STEP
                if self.held is None:
                    self.control.send_state()
                wait = self.began + self.now - clock().now()
                self.late = max(self.late, -wait)
                if wait < -BEHIND:
                    self.began -= wait
                if wait > 0.0:
                    clock().sleep(wait)
            if not self.obey():
                return

    def obey(self):
        """The next words, if there are any; False at the end."""
        if not select.select([sys.stdin], [], [], PAUSE)[0]:
            return True
        words = sys.stdin.readline().split()
        if words in ([], ["quit"]):
            return False
        if words == ["mark"]:
            self.mark()
        elif words == ["silent"]:
            self.held = self.sim.data.qpos[:7].copy()
        elif words[0] == "lead":
            self.lead(*map(float, words[1:]))
        elif words[0] == "mode":
            self.enter(*words[1:])
        print(json.dumps(self.truth()), flush=True)
        return True

    def lead(self, x, y, z, *turn):
        """A hand leads the tip to a place [mm] in the work frame, the tool turned from its by a vector [deg]."""
        now, place = self.sim.data.qpos[:7].copy(), np.array([x, y, z]) / 1e3
        self.hand, self.stands = (now, joints_of(self.bench, self.model, place, now, np.radians(turn).tolist())), 0.0

    def follow_hand(self):
        """A step towards where a hand leads the arm."""
        at, end = self.hand
        self.hand = at + np.clip(end - at, -PACE * STEP, PACE * STEP), end
        self.robot.joint_position_control(self.hand[0])

    def enter(self, mode, *errors):
        """End a motion, as a controller does at a collision, and this simulator does not; it keeps its error."""
        server, bits = self.control, [str(place) in errors for place in range(41)]
        motion, socket, sound = server.current_motion_id, server._tcp_socket, type(server).robot_state.fget

        class Elsewhere(type(server)):
            @property
            def robot_state(self):
                return sound(self).replace(robot_mode=RobotMode[mode], errors=bits, reflex_reason=bits)

        server.stop_motion(send_preemption_signal=False)
        server.__class__ = Elsewhere
        if motion:
            BaseCommand.send_response(socket, RobotCommand.kMove, motion, MoveStatus.kReflexAborted)
            server.reset_current_motion_id()


def recover(command, server):
    """What a controller does at a recovery, and this simulator only says."""
    server.__class__ = FrankaRobotServer
    command.reply(AutomaticErrorRecoveryStatus.kSuccess)


AutomaticErrorRecoveryCommand.handle = recover


def joints_of(bench, model, place, near, turn=(0.0, 0.0, 0.0)):
    """Joints for the tip at a place (3,) [m] in the work frame, the tool turned from its by a vector (3,) [rad]."""
    pose = bench.work.tool_pose(place)
    pose[:3, :3] = pose[:3, :3] @ rotation_matrix(turn)
    return model.joints_at(pose, matrix_of([*bench.tcp, *bench.tcp_rotation]), near, steps=200)


def bench_of(device, sensor, file, overrides):
    """The settings of palpate's bench of twins for a pipeline's arm and sensor."""
    table = {**device.work_settings, **sensor.twin_settings, "port": f'"{sensor.port}"'}
    table |= {"tip_mass": '"140 g"', "specimen.model": '"dr"'}
    entries = [f"twin.bench.{key}={value}" for key, value in table.items()]
    return load_pipeline(file, ['twin.bench.type="ur3e-bota"', *entries, *overrides]).twins["bench"]


def main(file, *overrides):
    """Serve a pipeline's arm and sensor."""
    stated = [entry for entry in overrides if not entry.startswith("twin.")]
    devices = load_pipeline(Path(file), stated).devices
    arm = devices["arm"]
    bench = bench_of(arm, devices["sensor"], Path(file), overrides)
    joints = joints_of(bench, arm.arm_model, np.array([*bench.place, bench.height]), np.array(arm.posture))
    rig = Rig(bench, arm.arm_model, joints.tolist())
    print(f"ready {rig.robot.hostname}", flush=True)
    rig.run()


if __name__ == "__main__":
    main(*sys.argv[1:])
