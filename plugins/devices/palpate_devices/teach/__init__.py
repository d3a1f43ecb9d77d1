"""``palpate calibrate teach``: where specimen and tip are, and what hangs at the flange, by leading the arm."""
