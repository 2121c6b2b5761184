"""Summarize a study: counts, consistency, and outlook."""
