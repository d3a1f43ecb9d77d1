"""``palpate plan``: motions looked at before they are made."""
