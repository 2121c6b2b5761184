"""Answers of a person, and which experiments are best according to them."""
