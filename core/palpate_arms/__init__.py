"""Parts that every arm needs, whoever makes it: limits of commands, servo, pace, reach, force, setpoints in memory."""
