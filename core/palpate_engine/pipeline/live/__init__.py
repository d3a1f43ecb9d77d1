"""Live runs: a rig in real time, its guard, and the states that it passes."""
