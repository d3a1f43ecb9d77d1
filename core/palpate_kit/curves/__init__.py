"""Many curves, each a row of a table: how they are read and fitted, marked, grouped and chosen."""
