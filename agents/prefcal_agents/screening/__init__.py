"""Screening: simulate many θ unseen, and ask only about those that the answers leave undecided."""
