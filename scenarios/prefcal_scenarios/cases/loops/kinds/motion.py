"""Four mechanical and electrical plants, with a cascade or a linear quadratic regulator."""

from math import inf, sqrt

from prefcal_env.experiments.experiment import Channel
from prefcal_env.knobs.knob import Knob
from prefcal_scenarios.cases.loops.controllers import TunedLQR, TunedPID
from prefcal_scenarios.cases.loops.loop import Loop
from prefcal_scenarios.cases.loops.plant import CompiledPlant
from prefcal_scenarios.cases.loops.right_hand_sides import BoostConverter, CartPole, Servo, Steering

from .parts import CASCADE, Vary, knobs, nominal, step_task


def servo(vary: Vary = nominal) -> Loop:
    """Return a servo drive with friction and backlash: position around speed."""
    parameters = Servo(load=vary(0.02), coulomb=vary(0.05), half_gap=vary(0.01), stiffness=vary(20.0))
    plant = CompiledPlant(
        parameters,
        states=(
            Channel("load angle", "rad", -6, 6),
            Channel("motor speed", "rad/s"),
            Channel("load speed", "rad/s"),
            Channel("twist", "rad"),
        ),
        inputs=(Channel("torque", "N m", -2, 2),),
        max_step=0.004,
        measured=(0, 1),
    )
    return Loop(
        name="servo",
        title="Cascade of a servo drive",
        brief="A drive turns its load by 1 rad; later a torque pulls at the load. The gear has "
        "backlash and the load sticks.",
        plant=plant,
        controller=TunedPID(CASCADE, inner=(0.0, -20.0, 20.0)),
        space=knobs(
            "K_outer=2:60:log 1/s, T_i_outer=0.3:30:log s, K_inner=0.03:1:log N m s/rad, "
            "T_i_inner=0.03:3:log s, T_f_inner=0.001:0.03:log s, b_outer=0:1"
        ),
        task=step_task(
            plant, 4.0, 0.004, x0=(0.0,) * 4, u0=(0.0,), target=1.0, d=(0.0, 0.3), noise=(5e-4, 0.05)
        ),
    )


def cart_pole(vary: Vary = nominal) -> Loop:
    """Return a pole that is balanced on a cart: weights of an LQR, and its sampling time."""
    parameters = CartPole(cart=vary(1.0), pole=vary(0.2), length=vary(0.6), friction=vary(0.3))
    plant = CompiledPlant(
        parameters,
        states=(
            Channel("position", "m", -2, 2),
            Channel("pole angle", "rad", -0.6, 0.6),
            Channel("speed", "m/s"),
            Channel("angular speed", "rad/s"),
        ),
        inputs=(Channel("force", "N", -10, 10),),
        max_step=0.01,
        measured=(0, 1, 2, 3),
    )
    return Loop(
        name="cart-pole",
        title="LQR of a cart with a pole",
        brief="A cart moves by 0.5 m and balances a pole; later a force pushes the cart.",
        plant=plant,
        controller=TunedLQR(fixed={"R": 1.0}),
        space=knobs(
            "Q_1=10:3e4:log, Q_2=1:1e4:log, Q_3=0.1:1e4:log, Q_4=0.1:1000:log, Q_z=0.001:1e4:log",
            Knob("T_s", 0.01, 0.1, "s", step=0.01),
        ),
        task=step_task(
            plant,
            10.0,
            0.02,
            x0=(0.0,) * 4,
            u0=(0.0,),
            target=0.5,
            d=(0.0, 1.5),
            noise=(1e-3, 2e-3, 0.01, 0.02),
        ),
        beside=1,
    )


def boost_converter(vary: Vary = nominal) -> Loop:
    """Return a boost converter: voltage around current."""
    parameters = BoostConverter(inductance=vary(0.2), capacitance=vary(0.47), load=vary(12.0))
    start = 18.0
    loss = start * parameters.resistance / parameters.load
    open_share = (parameters.supply + sqrt(parameters.supply**2 - 4 * start * loss)) / (2 * start)
    current = start / parameters.load / open_share
    plant = CompiledPlant(
        parameters,
        states=(Channel("voltage", "V", -5, 50), Channel("coil current", "A", -30, 40)),
        inputs=(Channel("duty cycle", "", 0.0, 0.8),),
        max_step=0.02,
        measured=(0, 1),
        time_unit="ms",
    )
    return Loop(
        name="boost-converter",
        title="Cascade of a boost converter",
        brief="A converter raises its output from 18 V to 24 V; later the load draws more current. "
        "A larger duty cycle first lowers the voltage.",
        plant=plant,
        controller=TunedPID(CASCADE, inner=(current, 0.0, 15.0)),
        space=knobs(
            "K_outer=0.03:3:log A/V, T_i_outer=0.1:20:log ms, K_inner=0.003:0.3:log 1/A, "
            "T_i_inner=0.03:3:log ms, T_f_outer=0.01:1:log ms, b_outer=0:1"
        ),
        task=step_task(
            plant,
            20.0,
            0.02,
            x0=(start, current),
            u0=(1 - open_share,),
            target=24.0,
            d=(0.0, 0.8),
            noise=(0.05, 0.05),
        ),
        beside=1,
    )


def steering(vary: Vary = nominal) -> Loop:
    """Return a vehicle that changes lanes: lateral position around heading."""
    parameters = Steering(speed=vary(15.0), wheelbase=vary(2.8), lag=vary(0.15))
    plant = CompiledPlant(
        parameters,
        states=(
            Channel("lateral position", "m", -4, 8),
            Channel("heading", "rad", -1, 1),
            Channel("steering angle", "rad"),
        ),
        inputs=(Channel("steering command", "rad", -0.4, 0.4),),
        max_step=0.02,
        measured=(0, 1),
    )
    return Loop(
        name="steering",
        title="Cascade of a vehicle's steering",
        brief="A car moves over by 3.5 m; later side wind makes it drift.",
        plant=plant,
        controller=TunedPID(CASCADE, {"T_i_inner": inf}, inner=(0.0, -0.2, 0.2)),
        space=knobs(
            "K_outer=0.01:0.3:log rad/m, T_i_outer=3:300:log s, T_d_outer=0.01:1:log s, K_inner=0.1:5:log, "
            "T_f=0.005:0.5:log s, b_outer=0:1"
        ),
        task=step_task(
            plant, 20.0, 0.04, x0=(0.0,) * 3, u0=(0.0,), target=3.5, d=(0.0, 0.5), noise=(0.02, 0.002)
        ),
        beside=1,
    )
