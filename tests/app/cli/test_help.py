"""Every help text: complete, with an example, and whole at 80 columns."""

import itertools

import pytest

COMMANDS = [
    ["calibrate"],
    ["choose"],
    ["check"],
    ["report"],
    ["identify"],
    ["look"],
    ["verify"],
    ["export"],
    ["new"],
    *(
        ["studies", word]
        for word in ("list", "show", "rename", "rm", "export", "import", "verify", "respace")
    ),
]


@pytest.mark.parametrize("command", COMMANDS, ids=" ".join)
def test_help_teaches_with_an_example(prefcal, done, monkeypatch, command):
    monkeypatch.setenv("COLUMNS", "80")
    out = done(*command, "--help")
    assert "Examples" in out
    assert f"prefcal {' '.join(command)}" in out.partition("Examples")[2]
    assert "…" not in out  # no option or default is cut off
    assert "[/" not in out  # no markup that nobody has closed
    assert max(out) < "\U0001f000"  # the ":50:" of a range is no emoji


@pytest.mark.parametrize("command", COMMANDS, ids=" ".join)
def test_lines_of_help_break_only_where_they_are_full(done, monkeypatch, command):
    monkeypatch.setenv("COLUMNS", "80")
    lines = [line.rstrip() for line in done(*command, "--help").splitlines()]
    for line, following in itertools.pairwise(lines):
        text = line and following and not set("│╭╰") & {line.strip()[0], following.strip()[0]}
        if text and not line.startswith(" prefcal "):  # below a command stands what it does
            room = 79 - len(line)
            assert len(following.split()[0]) >= room - 5, line


@pytest.mark.parametrize("command", ["calibrate", "check"])
def test_help_on_a_limit_says_for_which_scenarios_it_is(done, command):
    out = " ".join(done(command, "--help").replace("│", " ").split())
    assert "It is for standard controllers (--plant), TOML files and FMUs; your own Python file states" in out


@pytest.mark.parametrize("command", [[], ["studies"], *COMMANDS], ids=" ".join)
def test_no_help_has_words_that_stumble(prefcal, command):
    out = " ".join(prefcal(*command, "--help")[1].replace("│", " ").split())
    for word in (" dear", " his ", " her ", " hers", "taken up", "begun", "whoever", "foretold"):
        assert word not in out.lower()
