"""`prefcal new fmu`: the starter runs as it is written."""

import pytest

FMU = """
from pythonfmu import DefaultExperiment, Fmi2Causality, Fmi2Slave, Fmi2Variability, Real


class Loop(Fmi2Slave):
    default_experiment = DefaultExperiment(start_time=0.0, stop_time=60.0, step_size=0.5)

    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.K_p, self.T_i, self.level, self.valve, self.sum = 10.0, 20.0, 1.0, 0.0, 0.0
        for name in ("K_p", "T_i"):
            self.register_variable(Real(name, causality=Fmi2Causality.parameter,
                                        variability=Fmi2Variability.tunable))
        for name in ("level", "valve"):
            self.register_variable(Real(name, causality=Fmi2Causality.output))

    def do_step(self, t, h):
        error = 2.0 - self.level
        self.sum += error * h / self.T_i
        self.valve = min(max(self.K_p * (error + self.sum), 0.0), 100.0)
        self.level += h * (0.004 * self.valve - 0.05 * self.level)
        return True
"""


def test_the_starter_of_an_fmu_runs_with_the_fmu_that_it_names(done, tmp_path):
    pytest.importorskip("fmpy")
    builder = pytest.importorskip("pythonfmu.builder")
    (tmp_path / "loop.py").write_text(FMU)
    builder.FmuBuilder.build_FMU(tmp_path / "loop.py", dest=tmp_path)
    (tmp_path / "Loop.fmu").rename(tmp_path / "loop.fmu")
    out = done("new", "fmu", "tank.toml")
    assert "Put the path of your FMU" in out
    out = done("check", "tank.toml")
    assert "settling time of level" in " ".join(out.split())
