"""Filters and models on many records, side by side in one table."""
