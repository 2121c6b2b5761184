import random
from dataclasses import replace

import numpy as np

from prefcal_bench import Cell, Result, digest

RESULTS = [
    Result(Cell(a, "camel", "perfect", s, 1, 2), ((0.1,), (0.2,)), (2.0, s + 0.1),
           (2.0, s + 0.1), (0, 1), (0.2,))
    for a in ("A", "B") for s in range(11)
]  # fmt: skip


def test_the_order_of_the_results_does_not_matter_and_their_numbers_do():
    total = digest(RESULTS)
    assert len(bytes.fromhex(total)) == 32
    mixed = random.Random(0).sample(RESULTS, len(RESULTS))
    assert digest(mixed) == total
    bit = replace(RESULTS[3], gaps=(2.0, RESULTS[3].gaps[1] + 1e-15))
    assert digest([*RESULTS[:3], bit, *RESULTS[4:]]) != total
    assert digest(RESULTS[:-1]) != total


def test_worth_kpis_and_comparisons_matter():
    plain = RESULTS[0]
    richer = [
        replace(plain, worth=(1.0, 2.0)),
        replace(plain, worth=(1.0, 2.0 + 1e-15)),
        replace(plain, kpi_names=("error",), kpis=((1.0,), (np.inf,))),
        replace(plain, comparisons=((1, 0, -1),)),
    ]
    assert len({digest([one]) for one in (plain, *richer)}) == 5


def test_times_and_the_words_of_a_failure_do_not_matter_but_that_it_failed():
    first, *rest = RESULTS
    assert digest([replace(first, seconds=0.1), *rest]) == digest(RESULTS)
    failed, other = (Result.failed(first.cell, why) for why in ("object at 0x7f11", "at 0x7f22"))
    assert digest([failed, *rest]) == digest([other, *rest]) != digest(RESULTS)
