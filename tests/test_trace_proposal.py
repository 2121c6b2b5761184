"""One proposal stays easy to follow: it enters few files and seldom changes between them."""

import importlib
from pathlib import Path

import pytest

BENCHMARKS = Path(__file__).parents[1] / "benchmarks"
FILES, CROSSINGS = 20, 300


@pytest.fixture
def trace_proposal(monkeypatch):
    monkeypatch.syspath_prepend(BENCHMARKS)
    # The script sets these for its own process, and must not for the tests after this one.
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", "1")
    monkeypatch.setenv("JAXTYPING_DISABLE", "1")
    return importlib.import_module("trace_proposal")


def test_a_proposal_enters_few_files(trace_proposal):
    traces = dict(trace_proposal.in_agent())
    assert list(traces) == ["GLISp, experiment 30", "GLISp, experiment 31"]
    for name, trace in traces.items():
        assert 0 < len(trace.calls) <= FILES, f"{name} enters {sorted(trace.calls)}"
        assert 0 < trace.crossings <= CROSSINGS, name
