"""The commands `prefcal report` and `prefcal studies`."""
