"""Agents to compare GLISp with: GLIS, random search and Latin hypercube."""
