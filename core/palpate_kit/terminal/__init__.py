"""Commands at the terminal: options, tables, progress, JSON, quantities with units."""
