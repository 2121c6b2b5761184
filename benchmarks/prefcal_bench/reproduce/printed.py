"""List the values printed in the paper: parameters, settings, and the results of section IV."""

from types import MappingProxyType

N_INIT, N_MAX, COMPARISONS = 10, 50, 49
"""Number of initial experiments, of experiments, and of comparisons of each study."""

THETA = MappingProxyType({
    "cstr-preferences": (0.31, 26.0, -1.79),
    "cstr-automated": (0.25, 26.0, -0.91),
    "overtake-preferences": (0.085, 0.310, 16.0, 0.261, 0.918),
})  # fmt: skip
"""Calibrated θ of each study, in the order of the scenario's knobs."""

T_COMP = 0.0808
"""Largest computation time of an MPC step at the car's calibrated θ [s]."""

CSTR_TABLE = MappingProxyType({
    "F/V": (1.0, "1/h"),
    "k_0": (3.49e7, "1/h"),
    "H": (5960.0, "kcal/kgmol"),
    "E": (11843.0, "kcal/kgmol"),
    "ρC_p": (500.0, "kcal/(m³ K)"),
    "US/V": (150.0, "kcal/(m³ K h)"),
    "R": (1.987, "kcal/(kgmol K)"),
    "T_c0": (298.0, "K"),
})  # fmt: skip
"""Table tab:CSTR_para: value and unit of each parameter."""

ALGORITHM = MappingProxyType({
    "experiments N_max": 50.0,
    "initial experiments N_init": 10.0,
    "exploration δ": 0.3,
    "tolerance σ": 1e-6,
    "initial ε": 1.0,
    "folds K": 3.0,
    "first cross-validation": 10.0,
    "last cross-validation": 40.0,
})  # fmt: skip
"""Settings of GLISp at the beginning of section IV."""

RANGES = MappingProxyType({
    "cstr": {"T_s": (0.25, 1.5), "N_p": (4.0, 40.0), "log Q_Δu": (-5.0, 3.0)},
    "overtake": {
        "T_s": (0.085, 0.5), "ε_c": (0.1, 1.0), "N_p": (10.0, 30.0),
        "log q_u11": (-5.0, 3.0), "log q_u22": (-5.0, 3.0),
    },
})  # fmt: skip
"""Ranges of the tuned parameters."""
