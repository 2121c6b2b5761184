"""FMUs of a tank under PI control, built by pythonfmu (FMI 2) and pythonfmu3 (FMI 3)."""

import zipfile
from pathlib import Path

import pytest

TANK = """
import os

from pythonfmu import DefaultExperiment, Fmi2Causality, Fmi2Slave, Fmi2Variability, Integer, Real


class Tank(Fmi2Slave):
    description = "Level of a tank under PI control."
    default_experiment = DefaultExperiment(start_time=0.0, stop_time=60.0, step_size=0.1)

    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.K_p, self.T_i, self.mode = 1.0, 10.0, 0
        self.level, self.valve, self.integral = 1.0, 0.0, 0.0
        tunable = {"causality": Fmi2Causality.parameter, "variability": Fmi2Variability.tunable}
        self.register_variable(Real("K_p", description="Gain", **tunable))
        self.register_variable(Real("T_i", description="Integral time", **tunable))
        self.register_variable(Integer("mode", description="What goes wrong", **tunable))
        self.register_variable(Real("level", causality=Fmi2Causality.output))
        self.register_variable(Real("valve", causality=Fmi2Causality.output))

    def do_step(self, t, h):
        error = 2.0 - self.level
        self.integral += error * h / self.T_i
        self.valve = min(max(self.K_p * (error + self.integral), 0.0), 10.0)
        self.level += h * (self.valve - self.level**0.5) / 5
        if t > 5:
            while self.mode == 1:
                pass
            if self.mode == 2:
                os.abort()
            if self.mode == 3:
                raise RuntimeError("the pump is dry")
            if self.mode == 4:
                self.level = float("nan")
        return True
"""
HANGS, CRASHES, RAISES, NAN = 1, 2, 3, 4
"""Values of `mode`: what happens after 5 s."""
TANK_3 = """
from pythonfmu3 import DefaultExperiment, Fmi3Causality, Fmi3Slave, Fmi3Variability, Float64, Unit


class Tank3(Fmi3Slave):
    description = "Level of a tank under PI control."

    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.default_experiment = DefaultExperiment(start_time=0.0, stop_time=60.0, step_size=0.1)
        self.time, self.K_p, self.T_i = 0.0, 1.0, 10.0
        self.level, self.valve, self.integral = 1.0, 0.0, 0.0
        self.register_units([Unit("m", m=1), Unit("s", s=1)])
        running = {"variability": Fmi3Variability.continuous}
        self.register_variable(Float64("time", causality=Fmi3Causality.independent, **running))
        tunable = {"causality": Fmi3Causality.parameter, "variability": Fmi3Variability.tunable}
        self.register_variable(Float64("K_p", **tunable))
        self.register_variable(Float64("T_i", unit="s", **tunable))
        self.register_variable(Float64("level", causality=Fmi3Causality.output, unit="m"))
        self.register_variable(Float64("valve", causality=Fmi3Causality.output))

    def do_step(self, t, h):
        error = 2.0 - self.level
        self.integral += error * h / self.T_i
        self.valve = min(max(self.K_p * (error + self.integral), 0.0), 10.0)
        self.level += h * (self.valve - self.level**0.5) / 5
        return True
"""


def built(folder: Path, version: int = 2) -> Path:
    """Build the tank's FMU in `folder`, for FMI 2 or 3; skip the test where an extra is missing."""
    pytest.importorskip("fmpy")
    builder = pytest.importorskip("pythonfmu" if version == 2 else "pythonfmu3")
    file = folder / f"tank{version}.py"
    file.write_text(TANK if version == 2 else TANK_3)
    return Path(builder.FmuBuilder.build_FMU(file, dest=folder))


def edited(fmu: Path, to: Path, old: str = "", new: str = "", without: str = "\0") -> Path:
    """Copy an FMU with another model description, and without the files whose names begin so."""
    with zipfile.ZipFile(fmu) as source, zipfile.ZipFile(to, "w") as target:
        for name in source.namelist():
            content = source.read(name)
            if name == "modelDescription.xml":
                assert old in content.decode()
                content = content.decode().replace(old, new).encode()
            if not name.startswith(without):
                target.writestr(name, content)
    return to
