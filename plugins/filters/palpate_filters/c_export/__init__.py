"""Filters for controllers: an estimator of a pipeline as C99 that needs nothing but libm."""
