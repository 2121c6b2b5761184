"""Runs on a live plant: what the person confirms, how far a run is, and how it ended."""
