"""``palpate check motion``: motions looked at before they are made."""
