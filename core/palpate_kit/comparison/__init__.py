"""Measures of many tracks on many records, and the standard set of simulated records."""
