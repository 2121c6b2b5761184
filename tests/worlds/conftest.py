"""Fixtures of `support.command_line`."""

from support.command_line import data_home as data_home
from support.command_line import done as done
from support.command_line import prefcal as prefcal
from support.command_line import refused as refused
