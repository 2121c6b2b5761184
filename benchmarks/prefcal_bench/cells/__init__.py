"""Cells of a benchmark: one agent on one problem with one seed, and the processes that run them."""
