"""Four plants of the process industry and of buildings, with several PIDs or a staged input."""

from math import sqrt

from prefcal_env.experiments.experiment import Channel
from prefcal_scenarios.cases.loops.controllers import TunedPID
from prefcal_scenarios.cases.loops.loop import Loop
from prefcal_scenarios.cases.loops.plant import CompiledPlant
from prefcal_scenarios.cases.loops.right_hand_sides import GRAVITY, Linear, QuadrupleTank, Tank

from .parts import Vary, knobs, nominal, step_task


def tank(vary: Vary = nominal) -> Loop:
    """Return a tank that widens upwards, so that its gain depends on the level."""
    parameters = Tank(bottom=vary(0.05), widening=vary(0.25), outlet=vary(4e-4), pump_gain=4e-5)
    start, target = 0.3, 0.6
    flow = parameters.outlet * sqrt(2 * GRAVITY * start)
    plant = CompiledPlant(
        parameters,
        states=(Channel("level", "m", 0.0, 1.0), Channel("pump flow", "m³/s")),
        inputs=(Channel("pump power", "%", 0, 100),),
        max_step=1.0,
    )
    return Loop(
        name="tank",
        title="PID of a tank that widens upwards",
        brief="The level of a tank is raised from 0.3 m to 0.6 m; later a leak opens. The tank "
        "must neither run dry nor overflow.",
        plant=plant,
        controller=TunedPID(),
        space=knobs(
            "K=20:2000:log %/m, T_i=10:1000:log s, T_d=0.2:20:log s, T_f=0.5:50:log s, b=0:1, T_t=5:500:log s"
        ),
        task=step_task(
            plant,
            600.0,
            2.0,
            x0=(start, flow),
            u0=(flow / parameters.pump_gain,),
            target=target,
            d=(0.0, -4e-4),
            noise=(0.003,),
        ),
    )


def quadruple_tank(vary: Vary = nominal) -> Loop:
    """Return Johansson's quadruple tank with a PI for each lower tank."""
    parameters = QuadrupleTank(outlet_1=vary(7.1e-6), outlet_2=vary(5.7e-6), pump_gain=vary(3.3e-6))
    u = 3.0
    levels = _resting_levels(parameters, u)
    plant = CompiledPlant(
        parameters,
        states=tuple(Channel(f"level {i}", "m", -0.001, 1.0) for i in range(1, 5)),
        inputs=(Channel("pump 1", "V", 0, 10), Channel("pump 2", "V", 0, 10)),
        max_step=1.5,
        measured=(0, 1),
    )
    return Loop(
        name="quadruple-tank",
        title="Two PIs of four tanks",
        brief="Two pumps fill four tanks, and each pump acts on both lower tanks. The level of "
        "tank 1 is raised by 3 cm while that of tank 2 stays; later more water flows into tank 1.",
        plant=plant,
        controller=TunedPID(suffixes=("_1", "_2")),
        space=knobs(
            "K_1=5:500:log V/m, T_i_1=5:500:log s, K_2=5:500:log V/m, T_i_2=5:500:log s, T_f=0.5:50:log s, "
            "b=0:1"
        ),
        task=step_task(
            plant,
            900.0,
            3.0,
            x0=levels,
            u0=(u, u),
            target=levels[0] + 0.03,
            d=(0.0, 2e-6),
            noise=(5e-4, 5e-4),
        ),
        controlled=2,
        beside=1,
    )


def _resting_levels(tanks: QuadrupleTank, u: float) -> tuple[float, ...]:
    """Return the levels [m] at which the tanks rest if both pumps have the voltage `u`."""
    up_1, up_2 = (1 - tanks.share_2) * u, (1 - tanks.share_1) * u
    flows = (
        (tanks.share_1 * u + up_1, tanks.outlet_1),
        (tanks.share_2 * u + up_2, tanks.outlet_2),
        (up_1, tanks.outlet_3),
        (up_2, tanks.outlet_4),
    )
    return tuple((tanks.pump_gain * flow / a) ** 2 / (2 * GRAVITY) for flow, a in flows)


def distillation(vary: Vary = nominal) -> Loop:
    """Return Skogestad's distillation column (LV configuration) with two PIs."""
    lag = vary(75.0)
    gains = ((0.878, -0.864), (1.082, -1.096))
    parameters = Linear(
        A=((-1 / lag, 0.0), (0.0, -1 / lag)),
        B=tuple(tuple(g / lag for g in row) for row in gains),
        E=((0.5 / lag,), (0.6 / lag,)),
    )
    plant = CompiledPlant(
        parameters,
        states=(Channel("top", "%", -20, 20), Channel("bottom", "%", -20, 20)),
        inputs=(Channel("reflux", "kmol/min", -50, 50), Channel("boilup", "kmol/min", -50, 50)),
        max_step=0.5,
        measured=(0, 1),
        dead_time=vary(1.0),
        time_unit="min",
    )
    return Loop(
        name="distillation",
        title="Two PIs of a distillation column",
        brief="Reflux and boilup act almost alike on the purity at the top and at the bottom. The "
        "top is raised by 0.5 % while the bottom stays; later the feed changes.",
        plant=plant,
        controller=TunedPID(suffixes=("_1", "_2"), signs=(1.0, -1.0)),
        space=knobs(
            "K_1=1:60:log kmol/(min %), T_i_1=3:300:log min, K_2=1:60:log kmol/(min %), "
            "T_i_2=3:300:log min, T_f=0.2:20:log min, b=0:1"
        ),
        task=step_task(
            plant, 400.0, 1.0, x0=(0.0, 0.0), u0=(0.0, 0.0), target=0.5, d=(0.0, 1.0), noise=(0.005, 0.005)
        ),
        controlled=2,
        beside=1,
    )


_COLD, _ROOM = 5.0, 18.0
"""Outdoor and room temperature at the start, °C."""


def building(vary: Vary = nominal) -> Loop:
    """Return a heated room: the radiator is heated in four stages, the walls store heat."""
    parameters, start, power = _heated_room(vary)
    plant = CompiledPlant(
        parameters,
        states=(
            Channel("room temperature", "°C", 0, 40),
            Channel("radiator temperature", "°C"),
            Channel("wall temperature", "°C"),
        ),
        inputs=(Channel("heating power", "%", 0, 100),),
        max_step=1.0,
        time_unit="min",
    )
    return Loop(
        name="building",
        title="Heating with four stages",
        brief="A room is heated from 18 °C to 21 °C; later it gets colder outside. The heater has "
        "four stages, and every switch wears it.",
        plant=plant,
        controller=TunedPID(fixed={"stages": 4.0}),
        space=knobs(
            "K=2:200:log %/K, T_i=10:1000:log min, T_d=0.5:50:log min, T_f=0.5:50:log min, b=0:1, "
            "hysteresis=0:0.5"
        ),
        task=step_task(plant, 960.0, 2.0, x0=start, u0=(power,), target=21.0, d=(_COLD, -2.0), noise=(0.05,)),
        staged=True,
    )


def _heated_room(vary: Vary) -> tuple[Linear, tuple[float, ...], float]:
    """Return a plant with time constants in min, its state [°C] and its power [%] at the start."""
    air, inside, leak = 1 / vary(80.0), 1 / vary(60.0), 1 / vary(400.0)
    wall, outside, radiator, heating = 1 / 600, 1 / 3000, 1 / 15, 0.5
    walls = (wall * _ROOM + outside * _COLD) / (wall + outside)
    hot = _ROOM + (inside * (_ROOM - walls) + leak * (_ROOM - _COLD)) / air
    plant = Linear(
        A=((-air - inside - leak, air, inside), (radiator, -radiator, 0.0), (wall, 0.0, -wall - outside)),
        B=((0.0,), (radiator * heating,), (0.0,)),
        E=((leak,), (0.0,), (outside,)),
    )
    return plant, (_ROOM, hot, walls), (hot - _ROOM) / heating
