"""Rows of setpoints as the process that commands an arm reads them."""

from palpate import Layout

SETPOINT = Layout(position=3, velocity=3, measuring=1)
# A row of a plan: a setpoint, the turn of the tool from its orientation by the work frame, in its own frame, and the
# plane of its station in the work frame, against which depth and angle are judged.
PLAN = Layout(position=3, velocity=3, measuring=1, turn=3, foot=3, normal=3)
