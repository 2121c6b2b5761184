"""The command line, called as a user calls it, in this process."""

import sys

import pytest

from prefcal_scenarios.app.cli import main


@pytest.fixture
def prefcal(monkeypatch, capsys, tmp_path):
    """Run a command line in an empty folder; gives exit code, stdout and stderr."""
    monkeypatch.chdir(tmp_path)

    def run(*words):
        monkeypatch.setattr(sys, "argv", ["prefcal", *words])
        code = 0
        try:
            main()
        except SystemExit as end:
            code = end.code or 0
        out = capsys.readouterr()
        return code, out.out, out.err

    return run
