"""Master curves by time-temperature superposition: shifts with their uncertainty, and laws of them."""
