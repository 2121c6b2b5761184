"""One proposal stays easy to follow: it enters few files and seldom changes between them."""

import pytest

from support.traces import PROPOSALS, proposal

FILES, CROSSINGS = 12, 195


@pytest.mark.parametrize(("make", "experiment"), PROPOSALS)
def test_a_proposal_enters_few_files(make, experiment):
    trace = proposal(make, experiment)
    assert 0 < trace.files <= FILES
    assert 0 < trace.crossings <= CROSSINGS
