"""FMUs for tests, built with pythonfmu (FMI 2) and pythonfmu3 (FMI 3)."""

import zipfile

_TWO = """
import os, time, math
from pythonfmu import DefaultExperiment, Fmi2Causality, Fmi2Slave, Fmi2Variability, Integer, Real

class {name}(Fmi2Slave):
    description = "A tank under PI control."
    default_experiment = DefaultExperiment(start_time=0.0, stop_time=20.0, step_size=0.1)

    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.K_p, self.T_i, self.order, self.fixed = 1.0, 10.0, 2, 3.0
        self.level, self.valve, self.integral, self.target = 1.0, 0.0, 0.0, 2.0
        P = dict(causality=Fmi2Causality.parameter)
        self.register_variable(Real("K_p", variability=Fmi2Variability.tunable, **P))
        self.register_variable(Real("T_i", variability=Fmi2Variability.fixed, **P))
        self.register_variable(Integer("order", variability=Fmi2Variability.tunable, **P))
        for name in ("level", "valve", "target"):
            self.register_variable(Real(name, causality=Fmi2Causality.output))

    def do_step(self, t, h):
        {trouble}
        error = self.target - self.level
        self.integral += error * h / self.T_i
        self.valve = self.K_p * (error + self.integral)
        self.level += h * (self.valve - abs(self.level) ** 0.5) / 5
        return True
"""
_THREE = """
from pythonfmu3 import DefaultExperiment, Fmi3Causality, Fmi3Slave, Fmi3Variability
from pythonfmu3 import Float64, Int32
from pythonfmu3.unit import Unit

class {name}(Fmi3Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.description = "A tank under PI control."
        self.default_experiment = DefaultExperiment(start_time=0.0, stop_time=20.0, step_size=0.1)
        self.units = {{"m": Unit("m", m=1), "s": Unit("s", s=1)}}
        self.time = 0.0
        self.K_p, self.T_i, self.order = 1.0, 10.0, 2
        self.level, self.valve, self.integral, self.target = 1.0, 0.0, 0.0, 2.0
        self.register_variable(Float64("time", causality=Fmi3Causality.independent,
                                       variability=Fmi3Variability.continuous))
        P = dict(causality=Fmi3Causality.parameter, variability=Fmi3Variability.tunable)
        self.register_variable(Float64("K_p", **P))
        self.register_variable(Float64("T_i", unit="s", **P))
        self.register_variable(Int32("order", **P))
        for name, unit in (("level", "m"), ("valve", None), ("target", "m")):
            self.register_variable(Float64(name, causality=Fmi3Causality.output, unit=unit))

    def do_step(self, t, h):
        {trouble}
        error = self.target - self.level
        self.integral += error * h / self.T_i
        self.valve = self.K_p * (error + self.integral)
        self.level += h * (self.valve - abs(self.level) ** 0.5) / 5
        return True
"""
TROUBLES = {
    "Tank": "pass",
    "Hangs": "if self.K_p > 3: time.sleep(3600)",
    "Crashes": "if self.K_p > 3: os.abort()",
    "Errs": "if self.K_p > 3 and t > 4.95: raise ValueError('the tank is dry')",
    "Diverges": "if self.K_p > 3 and t > 4.95: self.level = math.nan",
    "Once": (
        "if t < 0.01: os.environ['USES'] = os.environ.get('USES', '') + 'x'\n"
        "        if os.environ.get('USES') == 'xx': os.abort()"
    ),
    "Starts": "if self.K_p > 3 and t < 0.01: raise ValueError('never ready')",
}


def built(folder, name, version=2):
    """Build the FMU called `name` in `folder`, and return its path."""
    file = f"{name}{version}"
    script = folder / f"{file.lower()}.py"
    template = _TWO if version == 2 else _THREE
    script.write_text(template.format(name=file, trouble=TROUBLES[name]))
    if version == 2:
        from pythonfmu import FmuBuilder
    else:
        from pythonfmu3 import FmuBuilder
    FmuBuilder.build_FMU(script, dest=folder)
    return folder / f"{file}.fmu"


def changed(path, to, *, replace=(), without=""):
    """Copy an FMU to `to` with texts of its description replaced and some files left out."""
    with zipfile.ZipFile(path) as old, zipfile.ZipFile(to, "w") as new:
        for entry in old.namelist():
            content = old.read(entry)
            if entry == "modelDescription.xml":
                text = content.decode()
                for before, after in replace:
                    assert before in text, before
                    text = text.replace(before, after)
                content = text.encode()
            if not without or not entry.startswith(without):
                new.writestr(entry, content)
    return to
