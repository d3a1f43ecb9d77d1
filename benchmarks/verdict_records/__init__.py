"""Records whose truth is known, as instruments and robots of others write them; nothing is taken from the product."""
