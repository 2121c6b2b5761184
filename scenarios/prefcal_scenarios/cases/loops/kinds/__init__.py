"""Makers of the named loops: their plants, knobs, tasks and limits as data."""
