"""MCAP files: read in columns, searched, and recovered where they are damaged."""
