"""Four textbook processes, each with a PID."""

from prefcal_env.experiments.experiment import Channel
from prefcal_scenarios.cases.loops.controllers import TunedPID
from prefcal_scenarios.cases.loops.loop import Loop
from prefcal_scenarios.cases.loops.plant import CompiledPlant
from prefcal_scenarios.cases.loops.right_hand_sides import Linear

from .parts import Vary, knobs, nominal, step_task


def lag(vary: Vary = nominal) -> Loop:
    """Return a heat exchanger: two lags and a dead time."""
    gain, slow, fast = vary(0.8), vary(20.0), vary(8.0)
    plant = CompiledPlant(
        Linear(
            A=((-1 / slow, 1 / slow), (0.0, -1 / fast)), B=((0.0,), (gain / fast,)), E=((0.0,), (1 / fast,))
        ),
        states=(Channel("temperature", "°C", -20, 120), Channel("jacket temperature", "°C")),
        inputs=(Channel("valve", "%", 0, 100),),
        max_step=0.5,
        dead_time=vary(6.0),
    )
    return Loop(
        name="lag",
        title="PID of a heat exchanger",
        brief="The outlet of a heat exchanger is warmed up by 10 °C; later the inflow gets colder. "
        "The valve acts after a dead time.",
        plant=plant,
        controller=TunedPID(),
        space=knobs(
            "K=0.1:20:log %/°C, T_i=2:200:log s, T_d=0.2:40:log s, T_f=0.2:20:log s, b=0:1, T_t=1:200:log s"
        ),
        task=step_task(
            plant,
            400.0,
            1.0,
            x0=(gain * 50,) * 2,
            u0=(50.0,),
            target=gain * 50 + 10,
            d=(0.0, -8.0),
            noise=(0.1,),
        ),
    )


def integrating(vary: Vary = nominal) -> Loop:
    """Return a buffer tank, which integrates the difference of its flows."""
    rate, actuator = vary(0.05), vary(2.0)
    plant = CompiledPlant(
        Linear(A=((0.0, rate), (0.0, -1 / actuator)), B=((0.0,), (1 / actuator,)), E=((-rate,), (0.0,))),
        states=(Channel("level", "%", 0, 100), Channel("inflow", "%")),
        inputs=(Channel("valve", "%", 0, 100),),
        max_step=0.25,
        dead_time=vary(2.0),
    )
    return Loop(
        name="integrating",
        title="PID of a buffer tank",
        brief="The level of a buffer tank is raised by 10 %; later more flows out. The level "
        "integrates the difference of inflow and outflow.",
        plant=plant,
        controller=TunedPID(),
        space=knobs("K=0.2:20:log, T_i=3:300:log s, T_d=0.05:10:log s, T_f=0.1:10:log s, b=0:1"),
        task=step_task(
            plant, 200.0, 0.5, x0=(50.0, 40.0), u0=(40.0,), target=60.0, d=(40.0, 55.0), noise=(0.2,)
        ),
    )


def oscillatory(vary: Vary = nominal) -> Loop:
    """Return a flexible arm, whose oscillation hardly dies out by itself."""
    frequency, damping, actuator = vary(1.0), vary(0.1), vary(0.2)
    stiffness = frequency**2
    plant = CompiledPlant(
        Linear(
            A=((0.0, 1.0, 0.0), (-stiffness, -2 * damping * frequency, stiffness), (0.0, 0.0, -1 / actuator)),
            B=((0.0,), (0.0,), (1 / actuator,)),
            E=((0.0,), (stiffness,), (0.0,)),
        ),
        states=(Channel("position", "cm", -10, 10), Channel("speed", "cm/s"), Channel("actuator force", "N")),
        inputs=(Channel("force", "N", -3, 3),),
        max_step=0.05,
    )
    return Loop(
        name="oscillatory",
        title="PID of a flexible arm",
        brief="The tip of a flexible arm moves by 1 cm; later a force pushes it. Left alone, the "
        "arm oscillates for a long time.",
        plant=plant,
        controller=TunedPID(),
        space=knobs("K=0.03:10:log N/cm, T_i=0.1:10:log s, T_d=0.03:10:log s, T_f=0.02:2:log s, b=0:1"),
        task=step_task(plant, 60.0, 0.05, x0=(0.0,) * 3, u0=(0.0,), target=1.0, d=(0.0, 0.5), noise=(0.005,)),
    )


def unstable(vary: Vary = nominal) -> Loop:
    """Return an exothermic reactor, which runs away without control."""
    gain, growth, actuator = vary(1.0), vary(5.0), vary(0.3)
    plant = CompiledPlant(
        Linear(
            A=((1 / growth, gain / growth), (0.0, -1 / actuator)),
            B=((0.0,), (1 / actuator,)),
            E=((1 / growth,), (0.0,)),
        ),
        states=(Channel("temperature", "°C", -15, 15), Channel("heating", "°C")),
        inputs=(Channel("heating command", "°C", -20, 20),),
        max_step=0.05,
        dead_time=vary(0.4),
        time_unit="min",
    )
    return Loop(
        name="unstable",
        title="PID of an unstable reactor",
        brief="The temperature of an exothermic reactor is raised by 2 °C; later the reaction "
        "speeds up. Without control the temperature runs away.",
        plant=plant,
        controller=TunedPID(),
        space=knobs("K=1:20:log, T_i=1:100:log min, T_d=0.02:2:log min, T_f=0.02:1:log min, b=0:1"),
        task=step_task(plant, 40.0, 0.1, x0=(0.0, 0.0), u0=(0.0,), target=2.0, d=(0.0, 2.0), noise=(0.02,)),
    )
