"""What the reading process and its parent agree on."""

from palpate import Layout

from palpate_devices.process.ring import WORDS

MODULE = "palpate_devices.rdt.worker"
# A row of the ring: host's time [ns], number of the reading, status word, wrench.
ROW = Layout(host=1, sequence=1, status=1, wrench=6)
LOST, OUT_OF_ORDER = WORDS, WORDS + 1
