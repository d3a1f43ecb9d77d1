"""Rosbag2 bags: folders and databases, and what can be read of damaged ones."""
