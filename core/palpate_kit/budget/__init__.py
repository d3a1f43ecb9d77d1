"""The budget of uncertainty: what is not exactly known, and what it does to the values of a record."""
