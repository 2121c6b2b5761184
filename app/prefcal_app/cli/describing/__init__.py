"""Options that describe a scenario on the command line, for `calibrate` and `check`."""
