"""The continuous stirred tank reactor of section IV-A."""

import math
from dataclasses import astuple, dataclass, fields
from functools import lru_cache
from types import MappingProxyType

import numpy as np
import scipy
from jaxtyping import Float

from prefcal_env.errors import PlantError
from prefcal_env.experiments.experiment import Channel

from .plant import Equations, Jacobians, compiled, integrate, matrices_of, rates_of

X = Float[np.ndarray, " 2"]
D = Float[np.ndarray, " 2"]
U = Float[np.ndarray, " 1"]
Times = Float[np.ndarray, " K"]
States = Float[np.ndarray, "K 2"]

FEED = np.array([298.15, 10.0])  # the paper's feed stream: T_f [K], C_Af [kgmol/m³]


@dataclass(frozen=True, slots=True)
class CSTRParams:
    """Parameters of the reactor, table tab:CSTR_para."""

    F_V: float = 1.0  # 1/h
    k_0: float = 3.49e7  # 1/h
    H: float = 5960.0  # kcal/kgmol, released by the reaction
    E: float = 11843.0  # kcal/kgmol
    rho_Cp: float = 500.0  # kcal/(m³ K)
    US_V: float = 150.0  # kcal/(m³ K h)
    R: float = 1.987  # kcal/(kgmol K)

    units = MappingProxyType(
        {
            "F_V": "1/h",
            "k_0": "1/h",
            "H": "kcal/kgmol",
            "E": "kcal/kgmol",
            "rho_Cp": "kcal/(m³ K)",
            "US_V": "kcal/(m³ K h)",
            "R": "kcal/(kgmol K)",
        }
    )
    words = MappingProxyType(
        {
            "F_V": "feed per volume",
            "k_0": "rate constant",
            "H": "heat of reaction",
            "E": "activation energy",
            "rho_Cp": "heat capacity",
            "US_V": "heat transfer",
            "R": "gas constant",
        }
    )

    def __post_init__(self) -> None:
        for name in (each.name for each in fields(self)):
            if not 0 < getattr(self, name) < np.inf:
                raise PlantError(
                    f"CSTR parameter {name} must be positive and finite, got {getattr(self, name)}"
                )


def _f(x, u, d, p, out):  # type: ignore[no-untyped-def]
    """Write ẋ of eq. cstr_system_eqn; p are the parameters, in the order of `CSTRParams`."""
    r = p[1] * math.exp(-p[3] / (p[6] * x[0])) * x[1] if x[0] > 0 else 0.0  # eq. ratelaw
    out[0] = p[0] * (d[0] - x[0]) + p[2] / p[4] * r - p[5] / p[4] * (x[0] - u[0])
    out[1] = p[0] * (d[1] - x[1]) - r


def _jacobians(x, u, d, p, out):  # type: ignore[no-untyped-def]
    """Write A, B, C = 1 and D = 0, row by row."""
    k = p[1] * math.exp(-p[3] / (p[6] * x[0])) if x[0] > 0 else 0.0
    slope = k * x[1] * p[3] / (p[6] * x[0] ** 2) if x[0] > 0 else 0.0
    heat, cooling = p[2] / p[4], p[5] / p[4]
    out[0], out[1] = -p[0] + heat * slope - cooling, heat * k
    out[2], out[3] = -slope, -p[0] - k
    out[4], out[5] = cooling, 0.0
    out[6], out[7], out[8], out[9] = 1.0, 0.0, 0.0, 1.0
    out[10], out[11] = 0.0, 0.0


@dataclass(frozen=True)
class CSTR:
    """The reactor of eq. cstr_system_eqn with eq. ratelaw: x = (T [K], C_A [kgmol/m³]), u = T_c.

    The input T_c is in K, time in hours. Both states are outputs; measured disturbances are the
    feed's T_f [K] and C_Af [kgmol/m³].

    Deviation: the reaction heats the tank (+ H r/(ρ C_p)). As printed, with a minus, the only
    steady state at T_c = 298 K has C_A = 9.5; with a plus there are three, the paper's 8.56
    among them (to the digits of the table).

    Args:
        params: Physical parameters.
    """

    params: CSTRParams = CSTRParams()

    name = "CSTR"
    time_unit = "h"
    states = (Channel("temperature", "K", symbol="T"), Channel("concentration", "kgmol/m³", symbol="C_A"))
    outputs = states
    inputs = (Channel("coolant temperature", "K", low=284.0, high=310.0, symbol="T_c"),)
    disturbances = (
        Channel("feed temperature", "K", symbol="T_f"),
        Channel("feed concentration", "kgmol/m³", symbol="C_{Af}"),
    )

    @property
    def equations(self) -> Equations:
        """Return the compiled equations."""
        return _equations(self.params)

    def f(self, x: X, u: U, d: D) -> X:
        """Return ẋ of eq. cstr_system_eqn, (K/h, kgmol/(m³ h))."""
        return rates_of(_f, astuple(self.params), x, u, d)

    def g(self, x: X, u: U, d: D) -> X:
        """Return the outputs: both states."""
        return np.array(x, dtype=float)

    def jacobians(self, x: X, u: U, d: D) -> Jacobians:
        """Return the analytic derivatives of eq. cstr_system_eqn."""
        return matrices_of(_jacobians, astuple(self.params), x, u, d)

    def hold(self, x: X, u: U, d: D, times: Times) -> States:
        """Return the states at `times` [h]."""
        return integrate(self.equations, x, u, d, times)

    def steady_state_at_concentration(self, C_A: float, d: D = FEED) -> tuple[X, U]:
        """Return the only steady state (x, u) with concentration `C_A` [kgmol/m³], stable or not.

        Raises:
            PlantError: If `C_A` is not strictly between 0 and the feed's concentration, or would
                need a temperature above the one at which every molecule reacts.
        """
        p = self.params
        if not 0 < C_A < d[1]:
            raise PlantError(f"C_A must be in (0, {d[1]}) kgmol/m³, got {C_A}")
        k = p.F_V * (d[1] - C_A) / C_A
        if k >= p.k_0:
            raise PlantError(f"no temperature gives a concentration as low as {C_A} kgmol/m³")
        T = p.E / (p.R * np.log(p.k_0 / k))
        heating = p.F_V * (d[0] - T) + p.H / p.rho_Cp * p.F_V * (d[1] - C_A)
        return np.array([T, C_A]), np.array([T - heating * p.rho_Cp / p.US_V])

    def steady_states_at_input(self, T_c: float, d: D = FEED) -> Float[np.ndarray, "k 2"]:
        """Return all steady states (T, C_A) at coolant temperature `T_c` [K], by T, shape (k, 2).

        Raises:
            PlantError: If `T_c` is not positive and finite.
        """
        if not 0 < T_c < np.inf:
            raise PlantError(f"T_c must be positive and finite, got {T_c} K")
        p, u = self.params, np.array([T_c])

        def concentration(T: float) -> float:
            k = p.k_0 * math.exp(-p.E / (p.R * T)) if T > 0 else 0.0  # eq. ratelaw
            return float(p.F_V * d[1] / (p.F_V + k))

        def imbalance(T: float) -> float:
            return float(self.f(np.array([T, concentration(T)]), u, d)[0])

        grid = np.linspace(min(d[0], T_c) - 1.0, max(d[0], T_c) + p.H / p.rho_Cp * d[1] + 1.0, 2001)
        signs = np.sign([imbalance(T) for T in grid])
        roots = [
            scipy.optimize.brentq(imbalance, grid[i], grid[i + 1], xtol=1e-12)
            for i in np.flatnonzero(np.diff(signs))
        ]
        return np.array([[T, concentration(T)] for T in roots])


@lru_cache(maxsize=64)  # not an attribute of the plant: addresses mean nothing in another process
def _equations(params: CSTRParams) -> Equations:
    return compiled(_f, None, _jacobians, np.array(astuple(params)))
