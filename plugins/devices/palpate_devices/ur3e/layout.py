"""What the servo process and its parent agree on."""

MODULE = "palpate_devices.ur3e.worker"
COLUMNS = 42  # controller time [ns], host time [ns]; q, q', pose, speed, force (6 each), modes (3), setpoint (7)
STOP, RETRACT = 8, 9  # words of the ring by which the parent, from any thread, commands
