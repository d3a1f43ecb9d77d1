"""Code that several families share, below all of them: imports `palpate`, `palpate_engine`, `palpate_records` only."""
