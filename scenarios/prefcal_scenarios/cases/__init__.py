"""The cases that come with prefcal: the reactor, the overtaking and test functions."""
