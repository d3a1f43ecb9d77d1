"""Acquisition: processes of devices, shared rings, clocks of devices, lateness."""
