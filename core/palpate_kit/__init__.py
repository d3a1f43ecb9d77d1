"""What several families use, below all of them: imports `palpate`, `palpate_engine` and `palpate_records` only."""
