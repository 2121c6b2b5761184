"""Three plants of the family with an MPC: horizons, weights and sampling time are tuned."""

from dataclasses import replace

from prefcal_env.knobs.knob import Knob
from prefcal_env.knobs.space import KnobSpace

from ..loop import Loop
from ..mpc import MPC
from ..vary import Vary, nominal
from .basic import oscillatory, ratio
from .motion import boost_converter
from .processes import quadruple_tank


def _horizons(N_p: tuple[int, int], N_u: int) -> tuple[Knob, Knob]:
    """Return the knobs of both horizons, in steps."""
    return Knob("N_p", *N_p, integer=True), Knob("N_u", 1, N_u, integer=True)


def mpc_oscillatory(vary: Vary = nominal) -> Loop:
    """Return the flexible arm of `oscillatory` with an MPC, which can damp it."""
    loop = oscillatory(vary)
    return replace(
        loop,
        name="mpc-oscillatory",
        title="MPC of a flexible arm",
        controller=MPC(
            scales=(1.0,),
            moves=(1.0,),
            noise=loop.task.noise,
            process=(1e-3, 1e-2, 1e-3),
            on_inputs=(0,),
            fixed={"Q_1": 1.0},
        ),
        space=KnobSpace(
            [
                *_horizons((4, 40), 10),
                ratio("Q_du", 1e-4, 10.0),
                ratio("drift", 0.003, 3.0),
                Knob("T_s", 0.4, 1.2, "s", step=0.1),
            ]
        ),
    )


def mpc_quadruple_tank(vary: Vary = nominal) -> Loop:
    """Return the four tanks of `quadruple_tank` with one MPC for both pumps."""
    loop = quadruple_tank(vary)
    return replace(
        loop,
        name="mpc-quadruple-tank",
        title="MPC of four tanks",
        controller=MPC(
            scales=(0.03, 0.03),
            moves=(1.0, 1.0),
            noise=loop.task.noise,
            process=(1e-4,) * 4,
            on_inputs=(0, 1),
            fixed={"Q_1": 1.0},
        ),
        space=KnobSpace(
            [
                *_horizons((4, 40), 8),
                ratio("Q_du", 1e-3, 100.0),
                ratio("Q_2", 0.03, 30.0),
                ratio("drift", 1e-4, 0.1),
                Knob("T_s", 9.0, 24.0, "s", step=3.0),
            ]
        ),
    )


def mpc_boost_converter(vary: Vary = nominal) -> Loop:
    """Return the converter of `boost_converter` with an MPC of voltage and current."""
    loop = boost_converter(vary)
    return replace(
        loop,
        name="mpc-boost-converter",
        title="MPC of a boost converter",
        controller=MPC(
            scales=(6.0, 6.0),
            moves=(0.1,),
            noise=loop.task.noise,
            process=(0.02, 0.02),
            on_outputs=(1,),
            on_inputs=(0,),
            fixed={"Q_1": 1.0},
        ),
        space=KnobSpace(
            [
                *_horizons((3, 30), 6),
                ratio("Q_du", 1e-4, 10.0),
                ratio("drift", 0.003, 3.0),
                Knob("T_s", 0.2, 0.5, "ms", step=0.02),
            ]
        ),
    )
