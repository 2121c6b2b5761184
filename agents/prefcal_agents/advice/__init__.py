"""Advice about a study: whether to go on, and where to start from an earlier one."""
