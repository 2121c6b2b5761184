"""Answers of a person, and what follows from them about experiments."""
