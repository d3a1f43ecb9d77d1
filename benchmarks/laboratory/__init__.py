"""Palpations of a laboratory in which something is not what the model says; forces from the literature's formulas."""
