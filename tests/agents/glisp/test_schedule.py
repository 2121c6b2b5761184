import pytest

from prefcal_agents.glisp.selection import FEW, is_process_turn, process_turns

N_INIT = 10


def turns(count=60, n_init=N_INIT):
    return [is_process_turn(answered, n_init) for answered in range(n_init, count)]


def test_the_process_waits_until_there_are_a_few_answers_and_then_has_every_second_turn():
    early, late = turns()[: FEW - N_INIT + 1], turns()[FEW - N_INIT :]
    assert not any(early)
    assert late == [False, True] * (len(late) // 2)


def test_after_a_long_start_it_does_not_wait():
    assert turns(44, n_init=40) == [False, True, False, True]


@pytest.mark.parametrize("n_init", [1, 10, 20, 31])
def test_the_turns_of_the_process_are_counted(n_init):
    all_turns = turns(n_init=n_init)
    for before in range(len(all_turns)):
        assert process_turns(n_init + before, n_init) == sum(all_turns[:before])
