"""What every call of the command line would do, and few tests are about, is left out.

A report draws its figures, and a scenario out of a file runs in a process of its own: together
they take most of the time of a short study. A test, or a file, that is about one of them asks for
the fixture `figures` or `own_process`.
"""

import pytest

from support.calibrated import without_figures
from toy_study import TOY


@pytest.fixture
def figures():
    """Draw the figures of reports."""


@pytest.fixture
def own_process():
    """Run scenarios out of a file in a process of their own."""


@pytest.fixture(autouse=True)
def _quick(request, monkeypatch):
    if "figures" not in request.fixturenames:
        without_figures(monkeypatch)
    if "own_process" not in request.fixturenames:
        monkeypatch.setattr("prefcal_scenarios.isolated.is_own", lambda source: False)


@pytest.fixture
def rig_file(tmp_path):
    """Write own.py with a rig, and the same one without a cost or calibrators: `oven`."""
    (tmp_path / "own.py").write_text(
        "from dataclasses import replace\n"
        "from prefcal_env import Channel, Channels, Rig\n"
        f"from prefcal_scenarios import load\ntoy = load({TOY!r})\n"
        "channels = Channels((Channel('level', 'm'),), (), (Channel('level', 'm'),), 'h')\n"
        "rig = replace(toy, run=Rig(channels, (2.0,)), panels=(), kpis=(), references={})\n"
        "oven = replace(rig, calibrators={}, cost=None)\n"
    )
