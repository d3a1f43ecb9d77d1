"""Logs as sources of a pipeline: which of their numbers are force and position, and what reads them."""
