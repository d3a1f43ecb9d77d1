"""Universal Robots UR3e."""
