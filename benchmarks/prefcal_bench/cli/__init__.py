"""The commands `prefcal bench` and `prefcal reproduce`."""
