"""``palpate calibrate teach``: where the specimen is, whether the tip is where tcp says, and what hangs at the flange."""
