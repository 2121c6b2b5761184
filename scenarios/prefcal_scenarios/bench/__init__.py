"""The benchmark: agents on problems, by preferences, and what came out of it."""
