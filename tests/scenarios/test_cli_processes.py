"""What only a process of its own can show: Ctrl-C, errors of a rig, and a fast start."""

import json
import os
import signal
import subprocess
import sys
import time

import pytest

from toy_study import TOY_FILE

MAIN = "from prefcal_scenarios.cli import main; main()"
ENV = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path), "COLUMNS": "120"}


def start(folder, *words):
    return subprocess.Popen(
        [sys.executable, "-c", MAIN, *words],
        cwd=folder, env=ENV, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip


def wait_for(path, seconds=30.0):
    until = time.monotonic() + seconds
    while not path.exists():
        assert time.monotonic() < until, f"{path} never came"
        time.sleep(0.02)


@pytest.mark.parametrize("delay", [0.0, 1.0])
def test_ctrl_c_leaves_a_readable_partial_report(tmp_path, delay):
    process = start(
        tmp_path, "calibrate", f"{TOY_FILE}:slow", "--calibrator", "synthetic",
        "--agent", "random", "--n-max", "500", "--json", "--out", "out",
    )  # fmt: skip
    wait_for(tmp_path / "out")
    time.sleep(delay)
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=60)
    assert process.returncode == 130, err
    assert "Interrupted after" in err
    assert "Traceback" not in err
    result = json.loads(out)
    assert result["stopped"]
    assert (result["experiments"] >= 5) == (delay > 0)
    text = (tmp_path / "out" / "report.html").read_text("utf-8")
    assert f"after {result['experiments']} of 500 experiments" in text
    assert text.endswith("</html>\n")
    assert (tmp_path / "out" / "best.json").exists() == (result["experiments"] > 0)


def test_a_rig_that_breaks_down_leaves_a_report_and_its_own_error(tmp_path):
    (tmp_path / "rig.py").write_text(
        "from dataclasses import replace\n"
        f"from prefcal_scenarios.scenario import load\n"
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
    process = start(tmp_path, "calibrate", "rig.py:rig", *words)
    _, err = process.communicate(timeout=60)
    assert process.returncode not in (0, 2, 130)
    assert "the pump does not answer" in err
    assert "after 3 of 50 experiments" in (tmp_path / "out" / "report.html").read_text("utf-8")


def test_help_loads_neither_plots_nor_compilers_nor_agents(tmp_path):
    code = (
        "import sys\nfrom prefcal_scenarios.cli import app\n"
        "heavy = {'matplotlib', 'numba', 'numpy', 'prefcal_agents', 'prefcal_env'}\n"
        "print(sorted(heavy & set(sys.modules)))\n"
    )
    out = subprocess.run(
        [sys.executable, "-c", code], env=ENV, capture_output=True, text=True, check=True
    )
    assert out.stdout == "[]\n"
