"""A field of a dataclass is an option of a command, and everything else follows from that."""

import json
from dataclasses import dataclass, replace
from typing import Annotated

import pytest
import typer
from typer import Argument, Option
from typer.testing import CliRunner

from prefcal_app.cli.options import CheckOptions, LookOptions, Options, ReportOptions, RespaceOptions
from prefcal_app.cli.parameters import Stored, kept_by, parameters_of, takes
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
        opens: Do open.
    """

    name: Annotated[str, Argument(metavar="NAME")]
    rounds: Annotated[int, Option(metavar="N"), Stored()] = 3
    tags: Annotated[tuple[str, ...], Option("--tag", metavar="TAG"), Stored()] = ()
    learns: Annotated[bool, Option("--no-learning"), Stored()] = True
    opens: Annotated[bool, Option("--opens")] = False


@pytest.fixture
def typed():
    """Return what a command with these parameters is given for a line that people type."""

    def parse(*words):
        seen = {}
        app = typer.Typer()

        @app.command()
        @takes(Toy)
        def command(values):
            seen.update(values)

        assert CliRunner().invoke(app, words).exit_code == 0
        return seen

    return parse


def test_a_command_is_given_only_what_was_typed(typed):
    assert typed("x") == {"name": "x"}
    assert typed("x", "--rounds", "3") == {"name": "x", "rounds": 3}


def test_what_is_typed_arrives_with_the_type_of_its_field_and_a_flag_inverts_its_default(typed):
    words = ["x", "--rounds", "4", "--tag", "a", "--tag", "b", "--no-learning", "--opens"]
    assert typed(*words) == {"name": "x", "rounds": 4, "tags": ("a", "b"), "learns": False, "opens": True}


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


def test_the_study_file_keeps_what_is_declared_so_and_nothing_else():
    kept = Options(TOY, terminal=True, port=8000, seed=3).as_dict()
    assert list(kept) == list(kept_by(Options))
    assert kept["seed"] == 3
    assert "port" not in kept


def test_only_a_person_who_answers_has_a_name():
    assert Options(TOY, by="Ada").as_dict()["by"] == "Ada"
    with pytest.raises(SettingsError, match="--by names the person who answers, here synthetic does"):
        Options(TOY, by="Ada", calibrator="synthetic")


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


def test_another_tuning_is_compared_with_what_was_in_use_if_that_was_given_and_answers_count_again():
    mine = Options(scenario="lag", agent="screening", study="mine", n_init=1, n_max=11)
    first = "prefcal calibrate lag --calibrator human --agent screening --robust --seed 0 --n-init 1"
    assert mine.anew() == f"{first} --n-max 5 --taste mine"
    given = replace(mine, start=("K=2, T_i=20", "other:best"))
    assert given.anew() == f"{first} --n-max 6 --start 'K=2, T_i=20' --taste mine"
    program = replace(mine, calibrator="synthetic", agent="glisp", n_init=10)
    assert program.anew().endswith(" --calibrator synthetic --agent glisp --seed 0 --n-init 2 --n-max 2")
