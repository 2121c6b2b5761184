"""Whether a run of an interview can still win."""

from prefcal_agents import GLISp
from prefcal_agents.protocol.agent import Agent
from prefcal_env.errors import SettingsError
from prefcal_scenarios.app.session.experiments import ExperimentStore
from prefcal_scenarios.cutting import Chances
from prefcal_scenarios.kpis import can_be_cut
from prefcal_scenarios.scenario import Scenario


def chances_of(agent: Agent, store: ExperimentStore) -> Chances | None:
    """Return what decides whether the next run can still win; None if nothing does.

    It holds a copy of the agent, so it can be asked while the interview goes on.
    """
    if not isinstance(agent, GLISp) or not agent.settings.kpis or not can_be_cut(store.scenario):
        return None
    return Chances(agent.copy(), store.scenario)


def check_cutting(scenario: Scenario, agent: Agent, at_once: int) -> None:
    """Raise SettingsError unless runs of the scenario can be cut short."""
    if not isinstance(agent, GLISp) or not agent.settings.kpis:
        raise SettingsError(
            "only the agent glisp, told the KPIs, can tell that a run can no longer win: leave "
            f"--cut-short out, got {type(agent).__name__}"
        )
    if at_once > 1:
        raise SettingsError(
            f"runs are cut short one at a time: leave --cut-short or --at-once out, got {at_once}"
        )
    if not can_be_cut(scenario):
        raise SettingsError(
            f"runs of {scenario.name!r} cannot be cut short, since it does not say which KPIs can "
            "only get worse, or has several maneuvers: leave --cut-short out, or give a scenario "
            "of one maneuver a function so_far"
        )
