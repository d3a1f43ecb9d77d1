"""The words in the names of columns, and the quantity that each states."""

from __future__ import annotations

EXACT = {
    "force": ("force", "f", "fz", "f_z", "force_z", "forcez", "fn", "load"),
    "position": ("position", "pos", "z", "pos_z", "posz", "height", "depth", "displacement", "penetration"),
    "velocity": ("velocity", "vel", "v", "vz", "v_z", "vel_z", "velz", "speed"),
    "time": ("time", "t", "stamp", "timestamp", "second", "seconds", "sec", "secs"),
}
WORDS = {
    "force": (
        "force forces load kraft standardkraft prüfkraft prufkraft gewicht weight kuvvet carga fuerza forza charge "
        "kracht fz fn fnormal loadcell ft wrench 荷重 試験力 力 载荷"
    ),
    "position": (
        "position pos pose height depth displacement disp extension stroke travel distance crosshead indentation "
        "penetration piezo z weg standardweg traverse traversenweg hub höhe tiefe eindringtiefe verformung deformation "
        "uzama déplacement desplazamiento spostamento compression zpos 変位 ストローク 深さ 位移"
    ),
    "velocity": "velocity vel speed twist geschwindigkeit vz zdot dzdt",
    "time": "time timestamp stamp zeit prüfzeit prufzeit testzeit temps tiempo tempo süre zaman elapsed 時間 时间",
    "other": (
        "stress strain temperature torque moment energy index cycle cycles count points scan current humidity area "
        "cantilever spannung dehnung temperatur sample segment status mode orientation rotation acceleration "
        "width gripper finger fingers jaw aperture std stdev sd sem deviation error errors uncertainty variance "
        "応力 ひずみ 温度"
    ),
}
SPREADS = {
    "std",
    "stdev",
    "sd",
    "sem",
    "deviation",
    "error",
    "errors",
    "uncertainty",
    "variance",
}  # of a quantity's scatter
# Words of angles and torques, which are lengths or forces only if a unit says so, as that of a linear joint does.
_ANGULAR = (
    "joint joints j q qd dq ddq theta phi psi angle angles angular winkel gelenk roll pitch yaw rx ry rz tau torques "
    "moments effort efforts drehmoment couple tx ty tz mx my mz temp qx qy qz qw quat quaternion"
)
_CARTESIAN = "tcp tool tip ee eef flange pose cartesian"  # of an array whose elements are those of a place
_QUALIFIERS = "raw filtered filt mean avg median smooth corrected corr tared net abs actual meas n"
# Suffixes behind a "_" of amplifiers, converters, encoders and motors.
_READINGS = "V mV uV µV mA volt volts counts count cts adc lsb digits bits steps ticks pulses"
_READERS = "encoder motor stepper servo dxl adc voltage volts volt counts steps ticks pulses"
_CELLS = "loadcell cell hx bridge dms gauge"  # sensors whose raw numbers are counts
ANGULAR, CARTESIAN, QUALIFIERS, READINGS, READERS, CELLS = (
    frozenset(words.split()) for words in (_ANGULAR, _CARTESIAN, _QUALIFIERS, _READINGS, _READERS, _CELLS)
)
ELECTRICAL = frozenset(unit.lower() for unit in (*READINGS, "mV/V", "raw"))
VOLTS = ("v", "mv", "uv")
SYMBOLS = {"f": "force", "h": "position", "d": "position", "delta": "position", "δ": "position", "v": "velocity"}
EITHER = ("z", "piezo", "compression")  # words of a length, and of the axis or the kind of a force
BY_WORD = {word: role for role, words in WORDS.items() for word in words.split()}
