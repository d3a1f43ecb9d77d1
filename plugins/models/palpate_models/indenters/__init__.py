"""Tips: rigid, axisymmetric, pressed along their axis into a flat surface."""
