"""What `same_results.py` runs, before a change and after it."""
