"""Wire protocols that a driver and its twin share."""
