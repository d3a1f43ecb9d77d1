"""Agreement of two methods of measurement, and the precision of one."""
