"""Time that goes on to the next instant for which any thread waits."""
