"""`prefcal bench`, as a user calls it: options, output, exit codes, Ctrl-C and kill -9."""

import json
import os
import signal
import time
from pathlib import Path

import pytest

from support.processes import is_running, start, wait_until

OWN = Path(__file__).parents[1] / "bench_support" / "agents.py"
TINY = ["--problems", "camel", "--calibrators", "perfect", "--seeds", "2", "--n-max", "3"]


def bench(folder, *words, log):
    return start(folder, "bench", *words, PREFCAL_TEST_LOG=str(log))


def landed(folder, count):
    """Wait until there are so many results."""
    wait_until(lambda: len(list(folder.glob("results/*.json"))) >= count)


def test_json_is_all_there_is_on_standard_output(prefcal):
    words = ["bench", "--agents", "RandomSearch,LatinHypercube", *TINY, "--jobs", "1"]
    code, out, err = prefcal(*words, "--json")
    assert code == 0, err
    content = json.loads(out)
    assert len(bytes.fromhex(content["digest"])) == 32
    assert content["cells"] == 4
    assert {row["agent"] for row in content["table"]} == {"RandomSearch", "LatinHypercube"}
    assert all(row["seconds_per_proposal"] > 0 for row in content["table"])
    assert content["failures"] == content["trouble"] == []
    assert "4/4" in err

    code, out, err = prefcal(*words)
    assert "4 of 4 results are there already" in err
    assert content["digest"] in out
    assert "RandomSearch" in out


def test_a_failed_cell_is_named_and_the_exit_code_is_1(prefcal):
    agents = f"RandomSearch,{OWN}:Raises"
    code, out, err = prefcal("bench", "--agents", agents, *TINY, "--jobs", "1", "--json")
    assert code == 1
    (failure,) = json.loads(out)["failures"]
    assert (failure["agent"], failure["seed"]) == (f"{OWN}:Raises", 1)
    assert failure["failure"] == "OSError: the pump does not answer"
    assert "seed 1 failed: OSError: the pump does not answer" in err


def test_a_benchmark_that_an_agent_kills_says_what_is_kept_and_who_was_running(tmp_path):
    agents = f"{OWN}:Own,{OWN}:Murderer"
    words = ["--agents", agents, *TINY, "--jobs", "1", "--out", "out"]
    process = bench(tmp_path, *words, log=tmp_path / "log")
    _, err = process.communicate(timeout=60)
    assert process.returncode == -signal.SIGKILL
    assert "results so far are kept in out; the same command resumes" in err
    assert "Murderer on camel, perfect, seed 1 was running then" in err
    assert list((tmp_path / "out" / "results").glob("*.json"))


@pytest.mark.parametrize("count", [0, 2])
def test_ctrl_c_stops_at_once_and_keeps_what_has_landed(tmp_path, count):
    words = [
        "--agents",
        f"{OWN}:Slow",
        "--problems",
        "camel",
        "--calibrators",
        "perfect",
        "--n-max",
        "4",
        "--jobs",
        "2",
        "--out",
        "out",
        "--json",
    ]
    log = tmp_path / "log"
    log.touch()
    process = bench(tmp_path, *words, "--seeds", "500", log=log)
    wait_until((tmp_path / "out" / "duels").exists)  # from here on, workers are started
    time.sleep(0.3)
    landed(tmp_path / "out", count)
    os.killpg(process.pid, signal.SIGINT)  # a terminal sends it to all of them
    out, err = process.communicate(timeout=60)  # a whole benchmark takes longer
    assert process.returncode == 130, err
    assert out == ""
    assert "results are kept in out" in err
    assert "Traceback" not in err
    assert not any(is_running(int(line.split()[1])) for line in log.read_text().splitlines())


def test_after_a_kill_it_goes_on_to_the_same_digest_and_repeats_nothing(tmp_path):
    words = ["--agents", f"LatinHypercube,{OWN}:Slow", *TINY, "--seeds", "4", "--jobs", "2", "--json"]
    log = tmp_path / "log"
    process = bench(tmp_path, *words, "--out", "killed", log=log)
    landed(tmp_path / "killed", 3)
    process.kill()
    process.communicate()
    kept = {path.name for path in (tmp_path / "killed" / "results").glob("*.json")}
    assert 3 <= len(kept) < 8
    workers = {int(line.split()[1]) for line in log.read_text().splitlines()}
    wait_until(lambda: not any(map(is_running, workers)))  # nobody is left over

    log.write_text("")
    times = {name: (tmp_path / "killed" / "results" / name).stat().st_mtime_ns for name in kept}
    out, err = bench(tmp_path, *words, "--out", "killed", log=log).communicate(timeout=60)
    resumed = json.loads(out)
    assert f"{len(kept)} of 8 results are there already" in err
    for name, written in times.items():
        assert (tmp_path / "killed" / "results" / name).stat().st_mtime_ns == written
    undisturbed, _ = bench(tmp_path, *words, "--out", "whole", log=log).communicate(timeout=60)
    assert resumed["digest"] == json.loads(undisturbed)["digest"]
    assert resumed["table"] == json.loads(undisturbed)["table"]
