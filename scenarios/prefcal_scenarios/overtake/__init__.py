"""The room of lane keeping and overtaking, section IV-B."""

from prefcal_scenarios.overtake.criteria import calibrator as calibrator
from prefcal_scenarios.overtake.indicators import indicators as indicators
from prefcal_scenarios.overtake.room import make_tuning_env as make_tuning_env
from prefcal_scenarios.overtake.room import make_tuning_vector as make_tuning_vector
from prefcal_scenarios.overtake.room import overtake as overtake
from prefcal_scenarios.overtake.supervisor import Supervisor as Supervisor
from prefcal_scenarios.overtake.target import overtake_on as overtake_on
from prefcal_scenarios.overtake.variants import overtake_robust as overtake_robust
from prefcal_scenarios.overtake.variants import overtake_variants as overtake_variants
