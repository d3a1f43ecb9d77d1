"""Commands of the program that `ur_rtde` uploads to a controller, by their numbers in its command register."""

from __future__ import annotations

from enum import IntEnum


class ScriptCommand(IntEnum):
    """Numbers of the program of `ur_rtde` 1.6 that the twin carries out."""

    NONE = 0
    MOVEJ = 1
    MOVEJ_IK = 2
    MOVEL = 3
    MOVEL_FK = 4
    FORCE_MODE_STOP = 7
    ZERO_FORCE_SENSOR = 8
    SPEEDJ = 9
    SPEEDL = 10
    SERVOJ = 11
    SPEED_STOP = 15
    SERVO_STOP = 16
    SET_PAYLOAD = 17
    SERVOL = 24
    GET_STEPTIME = 26
    SET_TCP = 29
    GET_INVERSE_KINEMATICS_ARGS = 30
    PROTECTIVE_STOP = 31
    STOPL = 33
    STOPJ = 34
    SET_WATCHDOG = 35
    IS_POSE_WITHIN_SAFETY_LIMITS = 36
    IS_JOINTS_WITHIN_SAFETY_LIMITS = 37
    GET_TCP_OFFSET = 40
    GET_FORWARD_KINEMATICS_ARGS = 44
    GET_INVERSE_KINEMATICS_DEFAULT = 46
    IS_STEADY = 47
    SET_GRAVITY = 59
    STOP_SCRIPT = 255


# Commands that stay in the register and are carried out at every tick.
REALTIME_COMMANDS = frozenset({6, 9, 10, 11, 24, 25, 26, 27, 38, 58, *range(66, 72)})
READY, DONE = 1, 2  # status of the program in its output register
