"""A KPI of one's own stays easy to follow, from a scenario file to the next question on the page."""

from functools import partial
from itertools import pairwise

import pytest

import prefcal_agents
import prefcal_app
import prefcal_env
import prefcal_scenarios
from prefcal_agents import GLISp, Screening
from prefcal_app.session import Choice
from prefcal_app.view import now_view
from prefcal_scenarios.catalog import load
from support.interviews import begin, proceed
from support.traces import entered_files

PACKAGES = (prefcal_env, prefcal_agents, prefcal_scenarios, prefcal_app)
OWN = """
import numpy as np
from prefcal_env import Knob, KnobSpace, recorded
from prefcal_scenarios import KPI, Scenario


def run(theta, seed=0):
    t = np.arange(0.0, 10.0, 0.1)
    y = 1 - np.exp(-theta[0] * t)
    u = theta[0] * (1 - y)
    return recorded(theta, t, {"level": y}, {"valve": u}, {"level": 1.0},
                    kpis=lambda e: {"effort": float(np.abs(e.u).max())})


knobs = KnobSpace([Knob("K_p", 0.1, 5.0), Knob("T_i", 0.1, 5.0)])
own = Scenario("own", "Own", knobs, run, kpis=(KPI("effort", "Effort", "%", better="lower"),))
"""


def from_file_to_the_next_question(file, agent):
    """Load the scenario, run two θ, show the question, answer it, and show the next one."""
    interview = begin(load(f"{file}:own"), n_max=8, agent=agent)
    question = proceed(interview).question
    assert "Effort" in str(now_view(interview)["question"]["comparison"])
    interview.steps.answer(question.id, Choice.LEFT)
    proceed(interview)
    assert now_view(interview)["question"]["id"] != question.id


@pytest.mark.parametrize(
    ("agent", "files", "crossings"),
    [(GLISp, 76, 1_600), (partial(Screening, n_simulated=100), 90, 4_600)],
    ids=["GLISp", "Screening"],
)
def test_an_own_kpi_takes_few_ways_between_files(tmp_path, agent, files, crossings):
    for name in ("first", "own"):
        (tmp_path / f"{name}.py").write_text(OWN, encoding="utf-8")
    # Modules that are imported when they are first used do not count.
    from_file_to_the_next_question(tmp_path / "first.py", agent)
    entered = entered_files(lambda: from_file_to_the_next_question(tmp_path / "own.py", agent), PACKAGES)
    assert 0 < len(set(entered)) <= files
    assert 0 < sum(a != b for a, b in pairwise(entered)) <= crossings
