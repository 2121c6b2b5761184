"""The cases that come with prefcal: the reactor, the overtaking, closed loops, test functions."""
