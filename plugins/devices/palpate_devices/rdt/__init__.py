"""Force sensors whose box speaks RDT by UDP: ATI's Net F/T, OnRobot's HEX."""
