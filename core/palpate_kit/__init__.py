"""What several plugin families use, below all of them: imports `palpate` and `palpate_engine` only."""
