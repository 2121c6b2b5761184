"""Run the interview in a terminal, on a machine without a browser."""

from .converse import converse as converse
