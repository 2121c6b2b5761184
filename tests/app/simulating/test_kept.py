"""KPIs of simulated θ stay beside the study: never simulated twice, never trusted if damaged."""

from dataclasses import replace

import numpy as np
import pytest

from prefcal_app.simulating import SimulationFile, Simulator, key_of
from prefcal_env.knobs import KnobSpace
from prefcal_env.preferences.answer import Outcome
from prefcal_scenarios.runs import FailedRun
from support.unseen import unseen

THETAS = list(np.random.default_rng(0).uniform(0.1, 0.9, (5, 2)))
RAISES = np.array([0.99, 0.5])
CONFIGURATION = {"seed": 3}


def simulated(path, thetas, key="a"):
    with Simulator(unseen, jobs=0, kept=SimulationFile(path, key)) as simulator:
        return simulator.many(thetas)


def counted(monkeypatch, path, thetas, key="a"):
    """Return the KPIs of `thetas`, and how many of them had to run."""
    ran = []
    run = Simulator._keep
    monkeypatch.setattr(Simulator, "_keep", lambda self, arrived: ran.extend(arrived) or run(self, arrived))
    return simulated(path, thetas, key), len(ran)


def test_nothing_is_simulated_twice_not_even_what_raised_an_error(tmp_path, monkeypatch):
    path = tmp_path / "mine.simulated"
    first = simulated(path, [*THETAS, RAISES])
    assert counted(monkeypatch, path, [RAISES, *THETAS]) == ([first[-1], *first[:-1]], 0)
    assert first[-1] == {}


def test_every_number_comes_back_exactly(tmp_path):
    path, kpis = tmp_path / "mine.simulated", Outcome({"a": np.inf, "b": 0.1 + 0.2, "ü": -0.0})
    kept = SimulationFile(path, "a")
    kept.add(THETAS[0], kpis)
    kept.close()
    assert list(SimulationFile(path, "a").known.values()) == [kpis]


def test_no_worker_starts_if_results_are_kept(tmp_path, monkeypatch):
    path = tmp_path / "mine.simulated"
    first = simulated(path, THETAS)
    monkeypatch.setattr("prefcal_env.workers.Pool.start", None)
    with Simulator(unseen, jobs=1, kept=SimulationFile(path, "a")) as simulator:
        simulator.start()
        assert simulator.many(THETAS) == first


@pytest.mark.parametrize("why", ["late", "died"])
def test_what_the_machine_made_fail_is_tried_again(tmp_path, why):
    kept = SimulationFile(tmp_path / "mine.simulated", "a")
    simulator = Simulator(unseen, jobs=0, kept=kept)
    simulator.many(THETAS[:1])
    simulator._keep([(RAISES, FailedRun(RAISES, why, "it took too long"))])
    assert simulator.failed == 1
    simulator.close()
    assert len(SimulationFile(tmp_path / "mine.simulated", "a").known) == 1


def test_if_every_run_failed_all_are_tried_again(tmp_path, monkeypatch):
    simulated(tmp_path / "mine.simulated", [RAISES])
    assert counted(monkeypatch, tmp_path / "mine.simulated", [RAISES])[1] == 1


def test_what_something_else_simulated_is_not_used_and_replaced(tmp_path, monkeypatch):
    path = tmp_path / "mine.simulated"
    simulated(path, THETAS)
    assert counted(monkeypatch, path, THETAS[:2], key="b")[1] == 2
    assert len(SimulationFile(path, "b").known) == 2
    assert not SimulationFile(path, "a").known


def torn(content):
    return content[:-9]


def flipped(content):
    middle = len(content) // 2
    return content[:middle] + bytes([content[middle] ^ 1]) + content[middle + 1 :]


def with_noise(content):
    return content + b"\xff\xfe {}\n1 []\n"


@pytest.mark.parametrize(("damaged", "lost"), [(torn, 1), (flipped, 1), (with_noise, 0)])
def test_a_damaged_line_is_simulated_again_and_mended(tmp_path, monkeypatch, damaged, lost):
    path = tmp_path / "mine.simulated"
    first = simulated(path, THETAS)
    whole = path.read_bytes()
    path.write_bytes(damaged(whole))
    again, ran = counted(monkeypatch, path, [*THETAS, RAISES])
    assert again[:-1] == first
    assert ran == lost + 1
    assert len(SimulationFile(path, "a").known) == 6
    assert b"\xff" not in path.read_bytes()


@pytest.mark.parametrize("content", [b"SQLite format 3\0 a study", b"my own notes\n"])
def test_a_file_that_is_something_else_is_left_alone(tmp_path, content):
    path = tmp_path / "mine.simulated"
    path.write_bytes(content)
    assert all(simulated(path, THETAS))
    assert path.read_bytes() == content


def test_a_folder_that_cannot_be_written_keeps_nothing_and_stops_nothing(tmp_path):
    assert all(simulated(tmp_path / "missing" / "mine.simulated", THETAS))


def test_the_key_changes_with_what_kpis_follow_from():
    def key(scenario=unseen, source="unseen", configuration=CONFIGURATION, versions=None):
        return key_of(scenario, source, configuration, versions or {"numpy": "2"})

    better = tuple(replace(kpi, better=None) for kpi in unseen.kpis)
    others = [
        key(replace(unseen, kpis=better)),
        key(source="another"),
        key(configuration={"seed": 4}),
        key(versions={"numpy": "3"}),
        key(replace(unseen, space=KnobSpace(unseen.space.knobs[:1]))),
    ]
    assert key() == key()
    assert len({key(), *others}) == len(others) + 1
