"""What only a process of its own can show: Ctrl-C, errors of a rig, and a fast start."""

import json
import os
import signal
import subprocess
import sys

import pytest

from support.new_process import loaded_by
from support.processes import finished, start, wait_until
from toy_study import TOY_FILE


def interrupted(folder, runs):
    """An unattended study that is stopped during its experiment number `runs`."""
    (folder / "own.py").write_text(
        "from dataclasses import replace\n"
        "from prefcal_scenarios import load\n"
        f"slow = load({str(TOY_FILE)!r} + ':slow')\n"
        "def run(theta, seed=0):\n"
        "    with open('runs', 'a') as runs:\n"
        "        runs.write('.')\n"
        "    return slow.run(theta)\n"
        "plant = replace(slow, run=run)\n"
    )
    words = ["--agent", "random", "--n-max", "500", "--json", "--out", "out"]
    process = start(folder, "calibrate", "own.py:plant", "--calibrator", "synthetic", *words)
    wait_until(lambda: (folder / "runs").exists() and (folder / "runs").stat().st_size >= runs)
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=60)
    assert process.returncode == 130, err
    assert "Traceback" not in err
    return json.loads(out), err


def test_ctrl_c_leaves_a_readable_partial_report(tmp_path):
    result, err = interrupted(tmp_path, runs=8)
    assert "Writing the report ... (Ctrl-C again ends at once" in err
    assert err.index("Writing the report") < err.index("Interrupted after")
    assert result["stopped"]
    assert result["experiments"] >= 7
    text = (tmp_path / "out" / "report.html").read_text("utf-8")
    assert f"after {result['experiments']} of 500 experiments" in text
    assert text.endswith("</html>\n")
    assert (tmp_path / "out" / "best.json").exists()


def test_ctrl_c_before_the_first_experiment_reports_nothing(tmp_path):
    (tmp_path / "own.py").write_text(
        "import time\nfrom dataclasses import replace\n"
        "from prefcal_scenarios import load\n"
        f"toy = load({str(TOY_FILE)!r} + ':toy')\n"
        "def run(theta, seed=0):\n"
        "    open('running', 'w').close()\n"
        "    time.sleep(600)\n"
        "plant = replace(toy, run=run)\n"
    )
    words = ["--calibrator", "synthetic", "--agent", "random", "--json"]
    process = start(tmp_path, "calibrate", "own.py:plant", *words)
    wait_until((tmp_path / "running").exists)
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=60)
    assert process.returncode == 130, err
    assert "Stopping ..." in err
    assert "Writing the report" not in err
    assert "partial report" not in err
    assert json.loads(out)["report"] is None
    assert list(tmp_path.glob("prefcal-*")) == []


def test_a_rig_that_breaks_down_leaves_a_report_and_its_own_error(tmp_path):
    (tmp_path / "rig.py").write_text(
        "from dataclasses import replace\n"
        f"from prefcal_scenarios import load\n"
        f"toy = load({str(TOY_FILE)!r} + ':toy')\n"
        "runs = []\n"
        "def run(theta, seed=0):\n"
        "    runs.append(theta)\n"
        "    if len(runs) >= 4:\n"
        "        raise OSError('the pump does not answer')\n"
        "    return toy.run(theta)\n"
        "rig = replace(toy, run=run)\n"
    )
    words = ["--calibrator", "synthetic", "--agent", "random", "--out", "out"]
    code, _, err = finished(tmp_path, "calibrate", "rig.py:rig", *words)
    assert code not in (0, 2, 130)
    assert "the pump does not answer" in err
    assert "after 5 of 50 experiments" in (tmp_path / "out" / "report.html").read_text("utf-8")
    assert err.count("failed: ") == 2  # the third error in a row ends the study


def test_help_loads_neither_plots_nor_compilers_nor_agents():
    heavy = ("matplotlib", "numba", "numpy", "prefcal_agents.glisp", "prefcal_env")
    assert loaded_by("prefcal_app.cli", *heavy) == []


@pytest.mark.parametrize("encoding", ["cp1252", "ascii", "ascii:surrogateescape"])
@pytest.mark.parametrize("words", [["--help"], ["check", "own.py:toy"], ["check", "own.py:toy", "--json"]])
def test_what_an_encoding_lacks_is_replaced_and_ends_no_command(tmp_path, encoding, words):
    (tmp_path / "own.py").write_text(
        "from dataclasses import replace\n"
        "from prefcal_scenarios import load\n"
        f"toy = load({str(TOY_FILE)!r} + ':toy')\n"
        "run = toy.run\n"
        "def said(theta, seed=0):\n"
        "    print('θ ✓')\n"
        "    return run(theta)\n"
        "print('θ ✓')\n"
        "toy = replace(toy, run=said, title='Ein Füllstand θ ✓')\n",
        encoding="utf-8",
    )
    found = subprocess.run(
        [sys.executable, "-m", "prefcal_app", *words],
        cwd=tmp_path,
        capture_output=True,
        env=os.environ | {"PYTHONIOENCODING": encoding, "PYTHONUTF8": "0"},
        timeout=120,
    )
    assert found.returncode == 0, found.stderr
    assert b"UnicodeEncodeError" not in found.stderr
    if "--json" in words:
        checks = json.loads(found.stdout[found.stdout.index(b"{") :])["checks"]
        assert {"what": "θ of the experiment", "ok": True, "words": "as requested"} in checks


def test_a_file_called_as_a_library_in_the_folder_of_the_shell_hides_it_from_no_worker(tmp_path):
    (tmp_path / "json.py").write_text("x = 1\n")
    (tmp_path / "own.py").write_text(
        f"from prefcal_scenarios import load\ntoy = load({str(TOY_FILE)!r} + ':toy')"
    )
    found = subprocess.run(
        [sys.executable, "-P", "-m", "prefcal_app", "check", "own.py:toy"],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert (found.returncode, "json" in found.stderr) == (0, False), found.stdout + found.stderr
