"""Random sessions of a live plant break no promise; 10,000 of them are a benchmark."""

from pathlib import Path

import pytest

ROOT = Path(__file__).parents[3]


@pytest.fixture
def sessions(monkeypatch):
    monkeypatch.syspath_prepend(ROOT / "benchmarks" / "checks" / "outside")
    import live_sessions

    return live_sessions


def test_random_sessions_keep_every_promise(sessions):
    outcomes = sessions.run(300)
    assert sum(outcomes.values()) == 300
    assert {"killed", "time is up", "failed, lost", "unsafe"} <= set(outcomes)


def test_the_check_sees_a_write_that_is_too_fast(sessions, monkeypatch):
    from prefcal_env.live.parts import Written

    monkeypatch.setattr(Written, "step", lambda self, elapsed, period: 1e9)
    with pytest.raises(sessions.Broken, match="is faster than"):
        sessions.run(20)


def test_a_real_server_that_loses_its_connection_gets_its_old_values_back(sessions):
    pytest.importorskip("asyncua")
    import live_opcua

    assert sum(live_opcua.run(60.0, most=2).values()) == 2
