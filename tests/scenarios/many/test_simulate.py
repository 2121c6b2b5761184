"""Many experiments at once: the same results in the same order, whatever some of the runs do."""

import os
import pickle
import re
import signal
import subprocess
import sys
import threading
import time
from contextlib import nullcontext
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from prefcal_env import Knob, KnobSpace
from prefcal_env.errors import KnobError, ScenarioError, SettingsError
from prefcal_env.experiments.experiment import End
from prefcal_scenarios import FailedRun, load, simulate_iter, simulate_many
from prefcal_scenarios.runs import Simulated, processes_kept
from prefcal_scenarios.scenario import with_ranges
from support import many_runs
from support.many_runs import SPACE, many


def thetas(*whats, gain=0.25):
    return np.array([[what, gain] for what in whats], dtype=float)


def bits(result):
    """A result, comparable to the last bit."""
    assert isinstance(result, Simulated)
    kpis = [(name, np.float64(value).tobytes()) for name, value in result.kpis.items()]
    return result.theta.tobytes(), result.end, kpis, result.solved


def random_thetas(space, count):
    z = np.random.default_rng(1).random((count, len(space)))
    return space.decode_all(space.snap_all(z))


def no_workers():
    children = " ".join(path.read_text() for path in Path("/proc/self/task").glob("*/children"))
    lines = [Path(f"/proc/{pid}/cmdline").read_bytes() for pid in children.split()]
    return not any(b"prefcal_env.workers" in line for line in lines)


@pytest.mark.parametrize("name", ["servo", "cstr"])
def test_any_number_of_processes_gives_the_results_of_single_runs(name):
    scenario = load(name)
    tried = random_thetas(scenario.space, 6)
    alone = [bits(Simulated.of(scenario.run(theta, 3))) for theta in tried]
    for jobs in (1, 2):
        assert [bits(r) for r in simulate_many(name, tried, jobs=jobs, seed=3)] == alone


def test_whole_experiments_are_those_of_single_runs_and_cannot_be_changed():
    tried = random_thetas(SPACE, 9)
    tried[:, 0] = 0
    alone = [many.run(theta.copy(), 5) for theta in tried]
    for jobs in (1, 2):
        found = simulate_many(many, tried, jobs=jobs, seed=5, trajectories=True)
        assert found == alone
        assert not any(e.x.flags.writeable or e.theta.flags.writeable for e in found)


def test_what_remains_of_an_experiment_is_frozen():
    for jobs in (1, 2):
        low, high = simulate_many(many, [[0, 0.25], [0, 1.0]], jobs=jobs)
        assert (low.end, low.solved) == (End.TIME_UP, False)
        assert (high.end, high.solved) == (End.UNSAFE, True)
        assert set(low.kpis) == {"mean", "count", "never"}
        assert low.kpis["never"] == np.inf
        assert not low.theta.flags.writeable


def test_runs_that_raise_die_or_hang_are_data_in_their_places():
    runs, raises, dies = many_runs.RUNS, many_runs.RAISES, many_runs.DIES
    whats = [runs, raises, runs, dies, many_runs.HANGS, many_runs.NOTHING, runs]
    found = simulate_many(many, thetas(*whats), jobs=2, timeout=2.0)
    assert [r.theta[0] for r in found] == whats
    why = [r.why if isinstance(r, FailedRun) else "" for r in found]
    assert why == ["", "raised", "", "died", "late", "raised", ""]
    words = [r.words if isinstance(r, FailedRun) else "" for r in found]
    assert words[1].startswith("OSError: the pump does not answer (in many_runs.py:")
    assert "Traceback" in found[1].trace
    assert "and again when it ran alone: its process was ended by SIGKILL" in words[3]
    assert words[4] == "the run took longer than 2 s and was ended (timeout allows more)"
    assert "is a return missing" in words[5]
    assert (found[3].end, dict(found[3].kpis), found[3].solved) == (End.FAILED, {}, False)
    assert no_workers()


def test_without_processes_an_error_is_data_too():
    found = simulate_many(many, thetas(0, many_runs.RAISES, many_runs.LEAVES), jobs=1)
    assert [type(r) for r in found] == [Simulated, FailedRun, FailedRun]
    assert found[1].words.startswith("OSError: the pump does not answer (in many_runs.py:")


def test_results_come_in_order_even_if_the_first_one_takes_longest():
    results = simulate_iter(many, thetas(many_runs.WAITS, *[0] * 50), jobs=2)
    assert [r.theta[0] for r in results] == [many_runs.WAITS, *[0] * 50]


def test_the_iterator_reads_no_further_than_needed_and_ends_its_processes():
    read = []

    def endless():
        while True:
            read.append(None)
            yield np.array([0.0, 0.5])

    for jobs in (1, 2):
        results = simulate_iter(many, endless(), jobs=jobs)
        assert all(isinstance(next(results), Simulated) for _ in range(20))
        results.close()
        assert len(read) < 50_000
    assert no_workers()


def telling(lift):
    """A scenario whose KPIs are the process that ran it, and the second knob, lifted."""

    def run(theta, seed=0):
        made = many.run(theta.copy(), seed)
        return replace(made, kpis={"process": os.getpid(), "lifted": theta[1] + lift})

    return replace(many, kpis=(), run=run)


def processes(results):
    return {result.kpis["process"] for result in results}


def test_kept_processes_run_one_scenario_after_the_other():
    with processes_kept():
        [first] = simulate_many(telling(1.0), thetas(0), jobs=1, timeout=2.0)
        more = simulate_many(telling(2.0), thetas(*[many_runs.WAITS] * 3), jobs=2, timeout=2.0)
        with processes_kept():  # within another, nothing ends
            [again] = simulate_iter(telling(3.0), thetas(0), jobs=1, timeout=2.0)
        [without_limit] = simulate_many(telling(4.0), thetas(0), jobs=2)
    assert processes([first]) == processes([again])
    assert processes([first]) <= processes(more)
    assert processes([first]) != processes([without_limit])
    lifted = [each.kpis["lifted"] for each in (first, *more, again, without_limit)]
    assert lifted == [1.25, 2.25, 2.25, 2.25, 3.25, 4.25]
    assert no_workers()


def test_whatever_happens_in_kept_processes_later_calls_run():
    def ran():
        [found] = simulate_many(telling(0.0), thetas(0), jobs=1, timeout=2.0)
        return found.kpis["process"]

    with processes_kept():
        seen = [ran()]
        wild = simulate_many(many, thetas(many_runs.DIES, many_runs.HANGS, 0), jobs=1, timeout=2.0)
        assert [getattr(each, "why", "") for each in wild] == ["died", "late", ""]
        seen.append(ran())
        ends = simulate_iter(telling(0.0), thetas(0, 0), jobs=1, timeout=2.0)
        assert next(ends).kpis["process"] == seen[1]
        assert ran() != seen[1]  # two at once share no process
        ends.close()
        with pytest.raises(ScenarioError, match="cannot be sent"):
            simulate_many(replace(many, run=partial(many_runs.run, threading.Lock())), thetas(0), jobs=2)
        seen.append(ran())
    assert len(set(seen)) == 3
    assert no_workers()


def test_progress_tells_how_many_have_arrived(capsys):
    for jobs in (1, 2):
        told = []
        simulate_many(many, thetas(0, 0, 0), jobs=jobs, progress=lambda *a, t=told: t.append(a))
        assert told[-1] == (3, 3)
        assert [n for n, _ in told] == sorted({n for n, _ in told})
    simulate_many(many, thetas(0, 0, 0), jobs=1, progress=True)
    assert "3/3" in capsys.readouterr().err


def test_scenarios_made_on_the_spot_are_sent_too():
    factor = 3.0

    def twice(factor, theta, seed=0, space=SPACE):
        checked = space.check(theta)
        return replace(many.run(checked, seed), kpis={"gain": factor * checked[1]})

    made = replace(many, kpis=(), run=partial(twice, factor))
    wider = with_ranges(made, KnobSpace([SPACE.knobs[0], Knob("gain", 0.0, 9.0)]))
    (found,) = simulate_many(wider, [[0, 8.0]], jobs=2)
    assert found.kpis["gain"] == 24.0


def test_a_scenario_with_much_data_is_sent_too():
    data = np.arange(1e6)  # more than a pipe holds

    def run(theta, seed=0):
        return replace(many.run(theta, seed), kpis={"sum": data.sum()})

    found = simulate_many(replace(many, kpis=(), run=run), thetas(0, 0, 0), jobs=2)
    assert [result.kpis["sum"] for result in found] == [data.sum()] * 3


OWN = """
import numpy as np
from dataclasses import dataclass, replace
from helping import LIFT
from prefcal_env import Knob, KnobSpace
from prefcal_scenarios import load
from support.many_runs import many

@dataclass
class Plant:
    lift: float
    def run(self, theta, seed=0):
        return replace(many.run(theta, seed), kpis={"gain": theta[1] + self.lift})

plant = replace(many, kpis=(), run=Plant(LIFT).run)
"""


def test_a_file_of_ones_own_is_loaded_in_every_process(tmp_path, monkeypatch):
    (tmp_path / "own_many.py").write_text(OWN)
    (tmp_path / "helping.py").write_text("LIFT = 2.0\n")
    monkeypatch.chdir(tmp_path)
    for scenario in ("own_many.py:plant", replace(load("own_many.py:plant"), title="other")):
        (found,) = simulate_many(scenario, [[0, 0.25]], jobs=2)
        assert found.kpis["gain"] == 2.25


@pytest.mark.parametrize("kept", [nullcontext, processes_kept])
def test_two_files_of_one_name_do_not_mix(tmp_path, kept):
    scenarios = []
    for lift in (1.0, 2.0):
        folder = tmp_path / str(lift)
        folder.mkdir()
        (folder / "own_twin.py").write_text(OWN.replace("from helping import LIFT", f"LIFT = {lift}"))
        scenarios.append(load(f"{folder / 'own_twin.py'}:plant"))
    with kept():
        found = [simulate_many(each, [[0, 0.25]], jobs=2)[0] for each in [*scenarios, scenarios[0]]]
    assert [result.kpis["gain"] for result in found] == [1.25, 2.25, 1.25]


@pytest.mark.parametrize(
    ("by_now", "words"),
    [
        ("raise OSError('no such port')", "in another process: .*no such port.*jobs=1"),
        ("import os; os._exit(4)", "in another process: .*while it was loaded.*exit code 4"),
    ],
)
def test_a_file_that_loads_only_here_is_told(tmp_path, by_now, words):
    path = tmp_path / f"{tmp_path.name}.py"  # a name of its own
    path.write_text(OWN.replace("from helping import LIFT", "LIFT = 2.0"))
    scenario = load(f"{path}:plant")
    path.write_text(by_now)
    with pytest.raises(ScenarioError, match=words):
        simulate_many(scenario, thetas(0, 0), jobs=2)
    assert no_workers()


MAIN = """
from dataclasses import replace
from prefcal_scenarios import simulate_many
from support.many_runs import many

def run(theta, seed=0):
    return replace(many.run(theta, seed), kpis={"here": len(__name__)})

found = simulate_many(replace(many, kpis=(), run=run), [[0, 0.25]] * 5, jobs=2)
print(found[4].kpis["here"])
"""


def test_a_script_needs_no_guard(tmp_path):
    script = tmp_path / "script.py"
    script.write_text(MAIN)
    done = subprocess.run(
        [sys.executable, str(script)],
        capture_output=True,
        text=True,
        timeout=60,
        env=os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)},
        check=False,
    )
    assert (done.stdout, done.stderr) == ("8.0\n", "")


def test_ctrl_c_ends_the_workers_at_once():
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    threading.Timer(2.0, lambda: os.kill(os.getpid(), signal.SIGINT)).start()
    begun = time.monotonic()
    try:
        with pytest.raises(KeyboardInterrupt):
            simulate_many(many, thetas(many_runs.HANGS, many_runs.HANGS), jobs=2)
    finally:
        signal.signal(signal.SIGINT, before)
    assert time.monotonic() - begun < 10
    assert no_workers()


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ([0, 0.5], r"thetas must have shape \(N, 2\), got \(2,\)"),
        ([[0, 0.5], [0]], r"thetas must be numbers of shape \(N, 2\)"),
        ([[0, 0.5, 1.0]], r"row 0 of thetas: theta must have shape \(2,\)"),
        ([[0, 0.5], [0, 1.5]], r"row 1 of thetas: theta of knob 'gain' must be in \[0.0, 1.0\]"),
        ([[0, 0.5], [0, np.nan]], r"row 1 of thetas: theta must be finite"),
        ([[0.5, 0.5]], r"row 0 of thetas: theta of knob 'what' must be an integer"),
    ],
)
def test_thetas_that_do_not_fit_are_refused_with_their_row(wrong, words):
    with pytest.raises(KnobError, match=words):
        simulate_many(many, wrong, jobs=2)


@pytest.mark.parametrize(
    "options",
    [{"jobs": 0}, {"jobs": True}, {"jobs": 1.5}, {"timeout": 0.0}, {"timeout": np.nan}, {"seed": 0.5}],
)
def test_impossible_options_are_refused(options):
    with pytest.raises(SettingsError, match=next(iter(options))):
        simulate_iter(many, thetas(0), **options)


def test_scenarios_that_do_not_exist_or_cannot_be_sent_are_refused():
    with pytest.raises(ScenarioError, match="no scenario is called 'nothing'"):
        simulate_many("nothing", thetas(0))
    with pytest.raises(ScenarioError, match="must be a Scenario or its name"):
        simulate_many(3, thetas(0))
    locked = replace(many, run=partial(lambda lock, theta, seed=0: None, threading.Lock()))
    with pytest.raises(ScenarioError, match=r"cannot be sent to other processes.*jobs=1"):
        simulate_many(locked, thetas(0), jobs=2)


def test_nothing_to_run_starts_nothing():
    assert simulate_many(many, np.zeros((0, 2)), jobs=2) == []


def test_runs_leave_no_trajectories_in_any_process():
    def run(theta, seed=0):
        peak = re.search(r"VmHWM:\s+(\d+)", Path("/proc/self/status").read_text())[1]
        return replace(many.run(theta, seed), kpis={"peak": float(peak)})  # kB

    found = simulate_many(replace(many, kpis=(), run=run), thetas(*[0] * 3000), jobs=2)
    peaks = [result.kpis["peak"] for result in found]
    assert max(peaks) - max(peaks[:100]) < 4000  # all trajectories would take 24 MB
    assert len(pickle.dumps(found)) < 3000 * 400
