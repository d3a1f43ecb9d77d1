"""Bota SensONE, serial version."""
