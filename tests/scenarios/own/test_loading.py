"""Own files: a word soon of those that take long, exit is an error, and margins that their KPIs name."""

import logging
import sys

import numpy as np
import pytest

from prefcal_env.errors import ScenarioError
from prefcal_scenarios import load, own
from prefcal_scenarios.own import SAYS, module_at
from prefcal_scenarios.verification.nominal import margins_at


@pytest.fixture
def said(monkeypatch):
    """What is said while a file loads; it is said soon."""
    words = []
    listener = logging.Handler(logging.INFO)
    listener.emit = lambda record: words.append(record.getMessage())
    monkeypatch.setattr(SAYS, "handlers", [listener])
    monkeypatch.setattr(own, "_SOON", 0.3)
    SAYS.setLevel(logging.INFO)
    yield words
    SAYS.setLevel(logging.NOTSET)


def test_a_file_that_takes_long_to_load_is_named_with_its_line(tmp_path, said):
    path = tmp_path / "own.py"
    path.write_text("import time\ntime.sleep(1.5)\n")
    module_at(path)
    (words,) = said
    assert "loading own.py takes a while, it is in own.py:2: time.sleep(1.5)" in words


def test_nothing_is_said_of_a_file_that_loads_quickly(tmp_path, said):
    path = tmp_path / "own.py"
    path.write_text("x = 1\n")
    assert module_at(path).x == 1
    assert said == []


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("sys.exit(4)", r"SystemExit: 4 \(line 2\), in own.py:2: sys.exit\(4\)"),
        ("raise GeneratorExit", r"GeneratorExit: +\(line 2\)"),
    ],
)
def test_a_file_that_ends_the_program_is_an_error_with_its_line(tmp_path, line, words):
    path = tmp_path / "own.py"
    path.write_text(f"import sys\n{line}\n")
    with pytest.raises(ScenarioError, match=r"cannot load .*own.py': " + words):
        module_at(path)


@pytest.mark.parametrize("text", ["import fractions", "from fractions import Fraction", "import fractions.x"])
def test_a_file_with_the_name_of_a_library_that_it_imports_is_to_be_renamed(tmp_path, text):
    path = tmp_path / "fractions.py"
    path.write_text(f"{text}\n")
    with pytest.raises(ScenarioError, match=r"same name as the library 'fractions', .* rename the file"):
        module_at(path)


def test_a_file_with_the_name_of_a_library_that_nobody_imports_is_loaded(tmp_path):
    path = tmp_path / "xdrlib.py"
    path.write_text("x = 1\n")
    assert module_at(path).x == 1
    del sys.modules["xdrlib"]


@pytest.mark.parametrize("text", ["import wave\nwave.open", "from wave import open", "import wave.more"])
def test_a_file_beside_that_hides_a_library_is_named(tmp_path, text):
    (tmp_path / "wave.py").write_text("x = 1\n")
    path = tmp_path / "own.py"
    path.write_text(f"{text}\n")
    with pytest.raises(ScenarioError, match=r"wave\.py hides the library 'wave': rename it"):
        module_at(path)
    sys.modules.pop("wave", None)


def test_a_mistake_in_a_file_beside_that_hides_nothing_is_told_as_it_is(tmp_path):
    (tmp_path / "tank_of_mine.py").write_text("x = 1\n")
    path = tmp_path / "own.py"
    path.write_text("import tank_of_mine\ntank_of_mine.y\n")
    with pytest.raises(ScenarioError) as caught:
        module_at(path)
    assert "has no attribute 'y'" in str(caught.value)
    assert "rename" not in str(caught.value)


LOOP = """
import numpy as np
from prefcal_env import PID, Channel, ClosedLoop, Knob, KnobSpace, Plant, PlantEnv, Task
from prefcal_scenarios import KPI, Scenario

valve = Channel("valve", "%", low=-50, high=50)
plant = Plant.of(([2.0], [30.0, 1.0]), inputs=[valve], outputs=[Channel("T", "K", target=1.0)])
loop = ClosedLoop(
    PlantEnv(plant, Task(np.zeros(1), np.zeros(1), np.ones(1), horizon=60.0)),
    lambda theta: PID.of_gains(theta[0], 0.1, 0.0, T_s=1.0, plant=plant),
    KPIS,
)
KPIs = (KPI("M_s", "maximum sensitivity M_s", at_most=2.0, margin=True), KPI("end", "end", better="lower"))
scenario = Scenario("mine", "Mine", KnobSpace([Knob("K_p", 0.5, 5.0)]), loop, kpis=KPIs)
"""


def test_a_loop_of_an_own_file_measures_the_margins_that_its_kpis_name(tmp_path):
    file, theta = tmp_path / "mine.py", np.array([2.0])
    file.write_text(LOOP.replace("KPIS", 'lambda e: {"end": float(e.x[-1, 0])}'))
    made = load(f"{file}:scenario")
    known = margins_at(made.source.varied(), theta)
    values = made.run(theta).kpis
    assert values["M_s"] == pytest.approx(known.M_s, rel=1e-12)
    assert made.kpis[0].met(values["M_s"])
    # What its own code computes by that name stays, and nothing is measured beside it.
    (tmp_path / "own.py").write_text(LOOP.replace("KPIS", 'lambda e: {"end": 1.0, "M_s": 9.0}'))
    assert load(f"{tmp_path / 'own.py'}:scenario").run(theta).kpis == {"end": 1.0, "M_s": 9.0}
    (tmp_path / "no.py").write_text(
        LOOP.replace("KPIS", 'lambda e: {"end": 1.0}').replace(", margin=True", "")
    )
    no = load(f"{tmp_path / 'no.py'}:scenario")
    assert no.run(theta).kpis == {"end": 1.0}, "it is a KPI of their own, which their code has to compute"
