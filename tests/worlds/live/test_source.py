"""A live plant keeps the contract of sources."""

import numpy as np

from contracts.sources import source_contract
from worlds.live.memory import Memory, memory_rig, simulate_time


@source_contract
def test_live_plant(clause, tmp_path, monkeypatch):
    plant = Memory()
    simulate_time(plant, monkeypatch)
    clause(memory_rig(plant, tmp_path), np.array([2.0, 20.0]))
