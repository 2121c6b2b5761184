"""What is typed, at a terminal and through a pipe."""

import io
import os
import sys

import pytest
from rich.console import Console

from prefcal_app.terminal.showing import ask_line, typed


class Terminal(io.StringIO):
    """Standard input that says it is a terminal."""

    def isatty(self):
        return True


def test_the_end_of_the_input_stops_at_a_terminal(monkeypatch):
    def ends(*_, **__):
        raise EOFError

    console = Console(file=io.StringIO())
    monkeypatch.setattr(sys, "stdin", Terminal())
    monkeypatch.setattr(console, "input", ends)
    assert ask_line(console, "answer") == "x"


def test_lines_of_a_pipe_are_answers_and_are_printed(monkeypatch):
    monkeypatch.setattr(sys, "stdin", io.StringIO("Left\n s \n./A b.csv \n\nR\n\x1b[31m\n"))
    console = Console(file=io.StringIO())
    assert typed() is None
    assert [ask_line(console, "answer") for _ in range(5)] == ["Left", "s", "./A b.csv", "", "R"]
    ask_line(console, "answer")
    assert ask_line(console, "answer") == "x"
    assert console.file.getvalue().startswith("answer: Left\nanswer: s\nanswer: ./A b.csv\n")
    assert "\x1b" not in console.file.getvalue()


@pytest.mark.skipif(os.name != "posix", reason="needs a pseudo-terminal")
def test_a_line_typed_during_a_run_is_read_without_waiting(monkeypatch):
    person, terminal = os.openpty()
    with os.fdopen(terminal, "r", encoding="utf-8") as stdin:
        monkeypatch.setattr(sys, "stdin", stdin)
        assert typed() is None
        os.write(person, b"K")
        assert typed() is None  # no line yet
        os.write(person, b"\n\n")
        assert [typed(), typed(), typed()] == ["k", "", None]
    os.close(person)
