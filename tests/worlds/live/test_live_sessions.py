"""Random sessions of a live plant break no promise."""

import pytest

from worlds.live.sessions import simulated_sessions


def test_random_sessions_keep_every_promise():
    outcomes = simulated_sessions.run(300)
    assert sum(outcomes.values()) == 300
    assert {"killed", "time is up", "failed, lost", "unsafe"} <= set(outcomes)


def test_the_check_sees_a_write_that_is_too_fast(monkeypatch):
    from prefcal_env.worlds.live.plan import LiveKnob

    monkeypatch.setattr(LiveKnob, "step", lambda self, elapsed, period: 1e9)
    with pytest.raises(simulated_sessions.Broken, match="is faster than"):
        simulated_sessions.run(20)


def test_a_real_server_that_loses_its_connection_gets_its_old_values_back():
    pytest.importorskip("asyncua")
    from worlds.live.sessions import server_sessions

    found = server_sessions.run(60.0, most=4)
    assert found.ends.total() == 4
    assert found.writes
    assert found.broken == []


def test_the_check_of_a_real_server_sees_a_fast_write_and_a_late_restoration(monkeypatch):
    pytest.importorskip("asyncua")
    from prefcal_env.worlds.live.drive import Drive
    from prefcal_env.worlds.live.plan import LiveKnob
    from worlds.live.sessions import server_sessions

    with monkeypatch.context() as changed:
        changed.setattr(LiveKnob, "step", lambda self, elapsed, period: 1e9)
        found = server_sessions.run(10.0, most=6)
        assert any("is faster than" in words for words in found.broken)
    moved, calls = Drive._moved_to, []

    def late(self, targets):
        if not self.plant.connected:
            calls.clear()
        calls.append(self.writer.read() if self.plant.connected else None)
        return moved(self, targets) if not self.plant.connected or len(calls) > 6 else False

    monkeypatch.setattr(Drive, "_moved_to", late)
    found = server_sessions.run(10.0, most=12, first=7)
    assert any("idle samples" in words for words in found.broken)
