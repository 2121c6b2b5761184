"""The parts of deviations.py: every deviation from the paper, both ways."""
