"""What the servo process and its parent agree on."""

from palpate import Layout

MODULE = "palpate_devices.ur.worker"
_PARTS = {"joints": 6, "joint_speeds": 6, "position": 3, "rotation": 3, "velocity": 3, "turning": 3, "force": 6}
STATE = Layout(**_PARTS)  # as the controller sends it, of the tip in the frame of the base
POSE, TWIST = STATE.span("position", "rotation"), STATE.span("velocity", "turning")
MOTION = STATE.span("joints", "turning")
SETPOINT = Layout(position=3, velocity=3, measuring=1)
# A row of a plan: a setpoint, the turn of the tool from where the work frame wants it, in the tool's own frame, and the
# plane of its station in the work frame, against which depth and angle are judged.
PLAN = Layout(position=3, velocity=3, measuring=1, turn=3, foot=3, normal=3)
# A row of the ring: controller's and host's time [ns], the state, the modes of robot, safety and program, speed slider
# and scaling, the setpoint.
ROW = Layout(controller=1, host=1, **_PARTS, modes=3, paces=2, setpoint=SETPOINT.size)
STOP, RETRACT = 8, 9  # words of the ring by which the parent, from any thread, commands
