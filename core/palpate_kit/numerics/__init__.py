"""Numerical methods: least squares, local cubics, contact point, holds."""
