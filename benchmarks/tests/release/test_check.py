"""The check of a release runs every command, and notices a wheel whose command is broken."""

import importlib
import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[3]
posix = pytest.mark.skipif(os.name == "nt", reason="shell scripts")


@pytest.fixture
def place(monkeypatch, tmp_path):
    """Return the release check, and an environment whose `prefcal` is this shell script."""
    monkeypatch.syspath_prepend(ROOT / "benchmarks" / "release")
    check = importlib.import_module("check")

    def made(script):
        for name, text in (("python", "echo 2.0.0"), ("prefcal", script)):
            if text:
                (tmp_path / name).write_text(f"#!/bin/sh\n{text}\n")
                (tmp_path / name).chmod(0o755)
        return check.Place(tmp_path, tmp_path / "python")

    return check, made


@posix
def test_the_release_check_starts_the_installed_command(place):
    check, made = place
    check.started(made('test "$1" = --help && echo Usage || echo prefcal 2.0.0'))


@posix
@pytest.mark.parametrize(
    ("script", "words"),
    [
        ("", "installs no command prefcal"),
        ("echo no such module; exit 1", "no such module"),
        ("echo prefcal 12.0.0 Usage", r"does not show 2\.0\.0"),
        ("echo prefcal 2.0.0", "shows no usage"),
    ],
)
def test_the_release_check_refuses_a_broken_command(place, script, words):
    check, made = place
    with pytest.raises(check.WrongError, match=words):
        check.smoke(made(script))


def test_every_command_is_run_before_a_release(place):
    check, _ = place
    listed = subprocess.run(
        [sys.executable, "-c", check.COMMANDS], capture_output=True, text=True, check=True
    )
    commands = set(filter(None, listed.stdout.splitlines()))
    assert commands - check.GROUPS == set(check.RUNS) - check.GROUPS
