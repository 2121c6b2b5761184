"""Four textbook processes, each with a PID."""

from prefcal_env.experiments.experiment import Channel
from prefcal_env.knobs.knob import Knob
from prefcal_env.knobs.space import KnobSpace
from prefcal_scenarios.cases.loops.controllers import PID
from prefcal_scenarios.cases.loops.loop import Loop, Task, Timing, Vary, nominal
from prefcal_scenarios.cases.loops.plants import Linear

SETPOINT_WEIGHT = Knob("b", 0.0, 1.0)
"""Share of the target's step that acts at once."""
CASCADE = ("_outer", "_inner")
"""Suffixes of the knobs of a cascade."""


def knobs(*each: Knob) -> KnobSpace:
    """Return the space of these knobs."""
    return KnobSpace(list(each))


def ratio(name: str, low: float, high: float, unit: str = "") -> Knob:
    """Return a knob of which ratios count."""
    return Knob(name, low, high, unit, scale="log10")


def lag(vary: Vary = nominal) -> Loop:
    """Return a heat exchanger: two lags and a dead time."""
    gain, slow, fast = vary(0.8), vary(20.0), vary(8.0)
    return Loop(
        name="lag",
        title="PID of a heat exchanger",
        brief="The outlet of a heat exchanger is warmed up by 10 °C; later the inflow gets colder. "
        "The valve acts after a dead time.",
        plant=Linear(
            A=((-1 / slow, 1 / slow), (0.0, -1 / fast)), B=((0.0,), (gain / fast,)), E=((0.0,), (1 / fast,))
        ),
        controller=PID(),
        space=knobs(
            ratio("K", 0.1, 20.0, "%/°C"),
            ratio("T_i", 2.0, 200.0, "s"),
            ratio("T_d", 0.2, 40.0, "s"),
            ratio("T_f", 0.2, 20.0, "s"),
            SETPOINT_WEIGHT,
            ratio("T_t", 1.0, 200.0, "s"),
        ),
        states=(Channel("temperature", "°C", -20, 120), Channel("jacket temperature", "°C")),
        inputs=(Channel("valve", "%", 0, 100),),
        task=Task((gain * 50,) * 2, (50.0,), (gain * 50 + 10,), ((0.0, -8.0),), (0.1,)),
        timing=Timing(0.5, 400.0, 1.0, 200.0, dead_time=vary(6.0)),
    )


def integrating(vary: Vary = nominal) -> Loop:
    """Return a buffer tank, which integrates the difference of its flows."""
    rate, actuator = vary(0.05), vary(2.0)
    return Loop(
        name="integrating",
        title="PID of a buffer tank",
        brief="The level of a buffer tank is raised by 10 %; later more flows out. The level "
        "integrates the difference of inflow and outflow.",
        plant=Linear(
            A=((0.0, rate), (0.0, -1 / actuator)), B=((0.0,), (1 / actuator,)), E=((-rate,), (0.0,))
        ),
        controller=PID(),
        space=knobs(
            ratio("K", 0.2, 20.0),
            ratio("T_i", 3.0, 300.0, "s"),
            ratio("T_d", 0.05, 10.0, "s"),
            ratio("T_f", 0.1, 10.0, "s"),
            SETPOINT_WEIGHT,
        ),
        states=(Channel("level", "%", 0, 100), Channel("inflow", "%")),
        inputs=(Channel("valve", "%", 0, 100),),
        task=Task((50.0, 40.0), (40.0,), (60.0,), ((40.0, 55.0),), (0.2,)),
        timing=Timing(0.25, 200.0, 0.5, 100.0, dead_time=vary(2.0)),
    )


def oscillatory(vary: Vary = nominal) -> Loop:
    """Return a flexible arm, whose oscillation hardly dies out by itself."""
    frequency, damping, actuator = vary(1.0), vary(0.1), vary(0.2)
    stiffness = frequency**2
    return Loop(
        name="oscillatory",
        title="PID of a flexible arm",
        brief="The tip of a flexible arm moves by 1 cm; later a force pushes it. Left alone, the "
        "arm oscillates for a long time.",
        plant=Linear(
            A=((0.0, 1.0, 0.0), (-stiffness, -2 * damping * frequency, stiffness), (0.0, 0.0, -1 / actuator)),
            B=((0.0,), (0.0,), (1 / actuator,)),
            E=((0.0,), (stiffness,), (0.0,)),
        ),
        controller=PID(),
        space=knobs(
            ratio("K", 0.03, 10.0, "N/cm"),
            ratio("T_i", 0.1, 10.0, "s"),
            ratio("T_d", 0.03, 10.0, "s"),
            ratio("T_f", 0.02, 2.0, "s"),
            SETPOINT_WEIGHT,
        ),
        states=(Channel("position", "cm", -10, 10), Channel("speed", "cm/s"), Channel("actuator force", "N")),
        inputs=(Channel("force", "N", -3, 3),),
        task=Task((0.0,) * 3, (0.0,), (1.0,), ((0.0, 0.5),), (0.005,)),
        timing=Timing(0.05, 60.0, 0.05, 30.0),
    )


def unstable(vary: Vary = nominal) -> Loop:
    """Return an exothermic reactor, which runs away without control."""
    gain, growth, actuator = vary(1.0), vary(5.0), vary(0.3)
    return Loop(
        name="unstable",
        title="PID of an unstable reactor",
        brief="The temperature of an exothermic reactor is raised by 2 °C; later the reaction "
        "speeds up. Without control the temperature runs away.",
        plant=Linear(
            A=((1 / growth, gain / growth), (0.0, -1 / actuator)),
            B=((0.0,), (1 / actuator,)),
            E=((1 / growth,), (0.0,)),
        ),
        controller=PID(),
        space=knobs(
            ratio("K", 1.0, 20.0),
            ratio("T_i", 1.0, 100.0, "min"),
            ratio("T_d", 0.02, 2.0, "min"),
            ratio("T_f", 0.02, 1.0, "min"),
            SETPOINT_WEIGHT,
        ),
        states=(Channel("temperature", "°C", -15, 15), Channel("heating", "°C")),
        inputs=(Channel("heating command", "°C", -20, 20),),
        task=Task((0.0, 0.0), (0.0,), (2.0,), ((0.0, 2.0),), (0.02,)),
        timing=Timing(0.05, 40.0, 0.1, 20.0, dead_time=vary(0.4), unit="min"),
    )
