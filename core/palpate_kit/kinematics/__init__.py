"""Kinematics: the arm of a robot, and the frame of the work."""
