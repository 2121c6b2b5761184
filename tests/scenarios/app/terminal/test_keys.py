"""What is typed, at a terminal and through a pipe."""

import io
import sys

import click
from rich.console import Console

from prefcal_scenarios.app.terminal.keys import ask_line, keys_of


class Terminal(io.StringIO):
    """Standard input that says it is a terminal."""

    def isatty(self):
        return True


def test_single_keys_at_a_terminal(monkeypatch):
    pressed = iter(["\x1b[D", "\x1b[C", "\x1bOB", "Q", "?", "L", "R"])
    monkeypatch.setattr(sys, "stdin", Terminal())
    monkeypatch.setattr(click, "getchar", lambda: next(pressed))
    key = keys_of(Console(file=io.StringIO()))
    assert [key() for _ in range(7)] == ["l", "r", "=", "q", "?", "l", "r"]


def test_the_end_of_the_input_stops_at_a_terminal_too(monkeypatch):
    def ends(*_, **__):
        raise EOFError

    console = Console(file=io.StringIO())
    monkeypatch.setattr(sys, "stdin", Terminal())
    monkeypatch.setattr(click, "getchar", ends)
    monkeypatch.setattr(console, "input", ends)
    assert (keys_of(console)(), ask_line(console, "file")) == ("x", "x")


def test_lines_of_a_pipe(monkeypatch):
    monkeypatch.setattr(sys, "stdin", io.StringIO("Left\n s \n./A b.csv \n\nR\n"))
    console = Console(file=io.StringIO())
    key = keys_of(console)
    assert [key(), key()] == ["left", "s"]
    assert [ask_line(console, "file"), ask_line(console, "file")] == ["./A b.csv", ""]
    assert key() == "r"
    assert [ask_line(console, "file"), key()] == ["x", "x"]
