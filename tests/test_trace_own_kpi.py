"""A KPI of one's own stays easy to follow, from a scenario file to the next question on the page."""

import pytest

from support.traces import AGENTS, answer, own_kpi


@pytest.mark.parametrize(
    ("agent", "files", "crossings"), [("GLISp", 35, 1_080), ("Screening", 39, 2_080)], ids=[*AGENTS]
)
def test_an_own_kpi_takes_few_ways_between_files(tmp_path, agent, files, crossings):
    trace = own_kpi(tmp_path, AGENTS[agent])
    assert 0 < trace.files <= files
    assert 0 < trace.crossings <= crossings


@pytest.mark.parametrize(
    ("agent", "files", "crossings"), [("GLISp", 27, 368), ("Screening", 27, 520)], ids=[*AGENTS]
)
def test_an_answer_takes_few_ways_to_the_next_question(agent, files, crossings):
    trace = answer(AGENTS[agent])
    assert 0 < trace.files <= files
    assert 0 < trace.crossings <= crossings
    assert 0 < trace.functions <= 490
    assert 0 < trace.stack <= 14
