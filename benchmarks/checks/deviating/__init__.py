"""Run every deviation from the paper both ways: the parts of deviations.py."""
