"""Run folders: their files, their tables of estimates, replay of their records."""
