"""What every arm needs, whoever makes it: limits of its commands, servo, pace, reach, force, setpoints in memory."""
