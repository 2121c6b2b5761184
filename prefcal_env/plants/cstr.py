"""The continuous stirred tank reactor of section IV-A."""

from dataclasses import astuple, dataclass
from functools import cached_property, lru_cache
from math import exp

import numpy as np
from jaxtyping import Float

from prefcal_env.errors import PlantError
from prefcal_env.experiments.experiment import Channel

from .equations import Equations, compiled
from .integrate import integrate
from .plant import Jacobians

X = Float[np.ndarray, " 2"]
D = Float[np.ndarray, " 2"]
U = Float[np.ndarray, " 1"]
Times = Float[np.ndarray, " K"]
States = Float[np.ndarray, "K 2"]

FEED = np.array([298.15, 10.0])
"""The paper's feed stream: T_f [K], C_Af [kgmol/m³]."""


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

    def __post_init__(self) -> None:
        for name in self.__dataclass_fields__:
            if not 0 < getattr(self, name) < np.inf:
                raise PlantError(
                    f"CSTR parameter {name} must be positive and finite, got {getattr(self, name)}"
                )


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
    states = (
        Channel("temperature", "K", symbol="T"),
        Channel("concentration", "kgmol/m³", symbol="C_A"),
    )
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

    @cached_property
    def _constant_jacobians(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return B, C and D."""
        cooling = self.params.US_V / self.params.rho_Cp
        return np.array([[cooling], [0.0]]), np.eye(2), np.zeros((2, 1))

    def f(self, x: X, u: U, d: D) -> X:
        """Return ẋ of eq. cstr_system_eqn, (K/h, kgmol/(m³ h))."""
        (T, C_A), (T_c,), (T_f, C_Af) = x.tolist(), u.tolist(), d.tolist()
        p = self.params
        r = self._rate(T) * C_A
        return np.array([
            p.F_V * (T_f - T) + p.H / p.rho_Cp * r - p.US_V / p.rho_Cp * (T - T_c),
            p.F_V * (C_Af - C_A) - r,
        ])  # fmt: skip

    def g(self, x: X, u: U, d: D) -> X:
        """Return the outputs: both states."""
        return np.array(x, dtype=float)

    def jacobians(self, x: X, u: U, d: D) -> Jacobians:
        """Return the analytic derivatives of eq. cstr_system_eqn."""
        T, C_A = x.tolist()
        p = self.params
        k = self._rate(T)
        dr_dT = k * C_A * p.E / (p.R * T**2)
        heat, cooling = p.H / p.rho_Cp, p.US_V / p.rho_Cp
        A = np.array([[-p.F_V + heat * dr_dT - cooling, heat * k], [-dr_dT, -p.F_V - k]])
        return Jacobians(A, *self._constant_jacobians)

    def hold(self, x: X, u: U, d: D, times: Times) -> States:
        """Return the states at `times` [h]."""
        return integrate(self.equations, x, u, d, times)

    def _rate(self, T: float) -> float:
        """Return the Arrhenius factor of eq. ratelaw, 1/h; 0 for impossible temperatures."""
        return self.params.k_0 * exp(-self.params.E / (self.params.R * T)) if T > 0 else 0.0

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
        from scipy.optimize import brentq  # takes half a second to import, and only this needs it

        p, u = self.params, np.array([T_c])

        def concentration(T: float) -> float:
            return float(p.F_V * d[1] / (p.F_V + self._rate(T)))

        def imbalance(T: float) -> float:
            return float(self.f(np.array([T, concentration(T)]), u, d)[0])

        lowest = min(d[0], T_c) - 1.0
        highest = max(d[0], T_c) + p.H / p.rho_Cp * d[1] + 1.0
        grid = np.linspace(lowest, highest, 2001)
        signs = np.sign([imbalance(T) for T in grid])
        roots = [
            brentq(imbalance, grid[i], grid[i + 1], xtol=1e-12)
            for i in np.flatnonzero(np.diff(signs))
        ]
        return np.array([[T, concentration(T)] for T in roots])


@lru_cache(maxsize=64)  # not an attribute of the plant: addresses mean nothing in another process
def _equations(params: CSTRParams) -> Equations:
    from . import _cstr_kernels  # loads the compiler

    return compiled(_cstr_kernels.f, None, _cstr_kernels.jacobians, np.array(astuple(params)))
