"""Hyperelastic laws for tables of stress over strain."""
