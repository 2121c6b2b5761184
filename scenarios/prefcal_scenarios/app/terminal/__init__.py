"""The terminal front end: the interview on a machine without a browser."""

from .converse import converse as converse
from .keys import keys_of as keys_of
