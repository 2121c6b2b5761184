"""One closed-loop experiment: the record, its KPIs, its panels, and how it is run."""
