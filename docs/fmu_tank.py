"""A tank with its PI controller as an FMU, to try `docs/fmu.md`: `python fmu_tank.py`.

Needs pythonfmu: pip install pythonfmu
"""

from pythonfmu import DefaultExperiment, Fmi2Causality, Fmi2Slave, Fmi2Variability, Real


class Tank(Fmi2Slave):
    description = "Level of a tank whose outflow a PI controller compensates."
    default_experiment = DefaultExperiment(start_time=0.0, stop_time=60.0, step_size=0.1)

    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.K_p, self.T_i = 1.0, 10.0  # gain in V/m, integral time in s
        self.level, self.valve, self.integral = 1.0, 0.0, 0.0  # m, V, m
        self.tunable("K_p", "gain of the controller")
        self.tunable("T_i", "integral time of the controller")
        for name in ("level", "valve"):
            self.register_variable(Real(name, causality=Fmi2Causality.output))

    def tunable(self, name, description):
        kind = {"causality": Fmi2Causality.parameter, "variability": Fmi2Variability.tunable}
        self.register_variable(Real(name, description=description, **kind))

    def do_step(self, current_time, step_size):
        error = 2.0 - self.level
        self.integral += step_size / self.T_i * error
        wanted = self.K_p * (error + self.integral)
        self.valve = min(max(wanted, 0.0), 5.0)
        if wanted != self.valve:
            self.integral -= step_size / self.T_i * error  # anti-windup
        self.level += step_size * 0.2 * (self.valve - max(self.level, 0.0) ** 0.5)
        return True


if __name__ == "__main__":
    from pythonfmu import FmuBuilder

    FmuBuilder.build_FMU(__file__, dest=".")
    print("Tank.fmu is built: prefcal finds the best K_p and T_i with your answers")
