"""An option of a command is declared once, and everything else follows from that."""

import json

import pytest

from prefcal_app.cli.commands import CheckOptions, LookOptions, ReportOptions
from prefcal_app.cli.options import Options
from prefcal_app.cli.parameters import kept_by, parameters_of
from prefcal_app.cli.studies.commands import RespaceOptions
from prefcal_env.errors import SettingsError
from toy_study import TOY


@pytest.mark.parametrize("options", [Options, CheckOptions, LookOptions, ReportOptions, RespaceOptions])
def test_every_option_has_its_help(options):
    assert all(parameter.info.help for parameter in parameters_of(options).values())


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
