"""The tests of the benchmark and of its scripts; what they share with those of prefcal is there."""

pytest_plugins = ["support.parts", "support.session", "support.command_line", "bench_support.session"]
