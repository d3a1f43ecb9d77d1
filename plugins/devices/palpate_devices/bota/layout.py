"""What the reading process and its parent agree on."""

from palpate import Layout

from palpate_devices.process.ring import WORDS

MODULE = "palpate_devices.bota.worker"
# A row of the ring: sensor's time [us], host's time [ns], status word, wrench, temperature [degC].
ROW = Layout(sensor=1, host=1, status=1, wrench=6, temperature=1)
DAMAGED, SKIPPED = WORDS, WORDS + 1
