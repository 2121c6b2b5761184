"""Advice about a study: whether to continue, and how to start from an earlier one."""
