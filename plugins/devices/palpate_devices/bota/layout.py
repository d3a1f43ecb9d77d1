"""What the reading process and its parent agree on."""

from palpate_devices.process.ring import WORDS

MODULE = "palpate_devices.bota.worker"
COLUMNS = 10  # sensor time [us], host time [ns], status; wrench (6), temperature
DAMAGED, SKIPPED = WORDS, WORDS + 1
