"""Points of the unit cube: the design of the start, and which points are feasible."""
