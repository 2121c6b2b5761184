"""What a person may want from the KPIs of experiments, and what answers teach about it."""
