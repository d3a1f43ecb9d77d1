"""A study as one file that a reader can check: packed, unpacked with suspicion, and made again."""
