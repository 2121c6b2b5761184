"""The command line, called as a user calls it, in this process."""

import sys

import pytest

from prefcal_app.cli import main


@pytest.fixture(autouse=True)
def data_home(monkeypatch, tmp_path):
    """Studies with a name go into a folder of the test, never into the user's."""
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path / "data"))


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


@pytest.fixture
def done(prefcal):
    """Run a command line that must succeed; gives stdout."""

    def run(*words):
        code, out, err = prefcal(*words)
        assert code == 0, out + err
        return out

    return run


@pytest.fixture
def refused(prefcal):
    """Run a command line that must be refused; gives what is said, as one line."""

    def run(*words):
        code, _, err = prefcal(*words)
        assert code == 2, err
        return " ".join(err.split())

    return run
