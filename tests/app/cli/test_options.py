"""An option of a command is declared once, and everything else follows from that."""

import json
from dataclasses import dataclass

import pytest
import typer
from typer.testing import CliRunner

from prefcal_app.cli.commands import CheckOptions, LookOptions, ReportOptions
from prefcal_app.cli.options import Options
from prefcal_app.cli.parameters import Kept, argument, given, kept_by, option, parameters_of, takes
from prefcal_app.cli.studies.commands import RespaceOptions
from prefcal_env.errors import SettingsError
from toy_study import TOY


@dataclass(frozen=True)
class Toy:
    """One option of each kind.

    Args:
        name: Name.
        rounds: How often, in words
            of two lines.
        tags: Tags.
        learns: Do not learn.
        opens: Do not open.
        folder: Folder.
    """

    name: str = argument("NAME")
    rounds: int = option(3, "N", kept=Kept(least=1))
    tags: tuple[str, ...] = option((), "TAG", flag="--tag", kept=Kept())
    learns: bool = option(True, flag="--no-learning", kept=Kept())
    opens: bool = option(True, flag="--no-opening")
    folder: str | None = option(None, "FOLDER")


@pytest.fixture
def typed():
    """Return what a command with these parameters is given for a line that people type."""

    def parse(*words):
        seen = {}
        app = typer.Typer()

        @app.command()
        @takes(Toy)
        def command(**values):
            seen.update(given(Toy, values))

        assert CliRunner().invoke(app, words).exit_code == 0
        return seen

    return parse


def test_what_a_study_keeps_is_none_unless_it_is_typed(typed):
    assert typed("x") == {
        "name": "x",
        "rounds": None,
        "tags": None,
        "learns": None,
        "opens": True,
        "folder": None,
    }


def test_what_is_typed_arrives_with_the_type_of_its_field(typed):
    words = ["x", "--rounds", "4", "--tag", "a", "--tag", "b", "--no-learning", "--no-opening"]
    assert typed(*words, "--folder", "f") == {
        "name": "x",
        "rounds": 4,
        "tags": ("a", "b"),
        "learns": False,
        "opens": False,
        "folder": "f",
    }


def test_the_help_of_an_option_is_its_line_in_the_docstring():
    assert parameters_of(Toy)["rounds"].info.help == "How often, in words of two lines."


@pytest.mark.parametrize("options", [Options, CheckOptions, LookOptions, ReportOptions, RespaceOptions])
def test_every_option_has_its_help(options):
    assert all(parameter.info.help for parameter in parameters_of(options).values())


def test_messages_name_an_option_as_it_is_typed():
    toy = parameters_of(Toy)
    assert toy["rounds"].said(4) == "--rounds 4"
    assert toy["tags"].said(()) == "no --tag"
    assert toy["tags"].said(("a", "b")) == "--tag a; b"
    assert toy["learns"].said(False) == "--no-learning on"
    assert toy["tags"].words(("a", "b")) == ["--tag", "a", "--tag", "b"]
    assert toy["rounds"].problem(0) == "--rounds must be at least 1, got 0"
    assert toy["rounds"].problem(1) == ""


def test_the_study_file_keeps_what_is_declared_so_and_nothing_else():
    kept = Options(TOY, terminal=True, port=8000, seed=3).as_dict()
    assert list(kept) == list(kept_by(Options))
    assert kept["seed"] == 3
    assert "port" not in kept


def test_options_of_one_run_may_change_on_resuming():
    stored = json.loads(json.dumps(Options(TOY).as_dict()))
    assert Options.resumed(stored, {"scenario": TOY, "port": 8000}).port == 8000
    for now, said in (
        ({"n_init": 2}, "started with --n-init 10, got --n-init 2"),
        ({"start": ("T_s=1",)}, "started with no --start, got --start T_s=1"),
        ({"n_max": 49}, "--n-max must not be below the 50"),
        ({"outcomes": False}, "started with --no-outcomes off"),
        ({"seed": 4}, "started with --seed 0, got --seed 4"),
        ({"agent": "lhs"}, "started with --agent glisp, got --agent lhs"),
    ):
        with pytest.raises(SettingsError, match=said):
            Options.resumed(stored, {"scenario": TOY, **now})
