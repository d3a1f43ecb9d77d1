"""``palpate acceptance``: how soon and how hard this very rig stops, measured and written down to be signed."""
