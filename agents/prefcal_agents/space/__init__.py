"""Points of the unit cube: the initial design, and which points are feasible."""
