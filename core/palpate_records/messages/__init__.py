"""Messages of any encoding as columns of numbers."""
