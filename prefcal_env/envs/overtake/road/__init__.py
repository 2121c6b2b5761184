"""The road of the overtaking: its geometry, its rules and the cars on it."""
