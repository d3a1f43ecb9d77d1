"""Recorded logs of any laboratory: containers (MCAP, rosbag2), payloads (CDR, JSON, protobuf), and what they mean."""
