"""Sweeps of settings: combinations as plain data, and their table."""
