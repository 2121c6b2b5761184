"""Optimizers from other packages as agents, for comparison; they need the extra `peers` or `rl`.

Only their rows are loaded here.
"""

from collections.abc import Mapping

from prefcal_agents.registry import AgentRow

_HERE = "prefcal_bench"


def _peer(name: str, module: str, packages: Mapping[str, str], *, by_value: bool = False) -> AgentRow:
    """Return the row of an agent that needs the extra `peers`."""
    home = f"peers.{module}"
    return AgentRow(name, home, by_value=by_value, extra="peers", packages=packages, package=_HERE)


_GLIS = {"glis": "glis", "pyswarm": "pyswarm", "pyDOE": "pyDOE"}
_OPTUNA = {"optuna": "optuna", "optuna_dashboard": "optuna-dashboard", "botorch": "botorch"}
_VALUE = {"optuna": "optuna", "torch": "torch"}
_BOTORCH = {"botorch": "botorch", "gpytorch": "gpytorch", "torch": "torch"}
_SB3 = {"stable_baselines3": "stable-baselines3", "torch": "torch"}
BANDITS = tuple(
    AgentRow(f"{label}Bandit", "rl", label=label, by_value=True, extra="rl", packages=_SB3, package=_HERE)
    for label in ("PPO", "SAC")
)
"""Agents of stable-baselines3."""
PEERS = (
    _peer("ReferenceGLISp", "reference", _GLIS),
    _peer("ReferenceGLIS", "reference", _GLIS, by_value=True),
    _peer("OptunaPreferential", "optuna_agents", _OPTUNA),
    _peer("EUBO", "botorch_agents", _BOTORCH),
    _peer("BOPE", "botorch_agents", _BOTORCH),
    _peer("OptunaTPE", "optuna_agents", _VALUE, by_value=True),
    _peer("OptunaGP", "optuna_agents", _VALUE, by_value=True),
)
"""Agents of other packages, in the order of tables."""
