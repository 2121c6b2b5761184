import pytest

from prefcal_agents.schedule import FEW, Turn, process_turns, turn_of

N_INIT = 10


def turns(count=60, n_init=N_INIT, **options):
    settings = {"process": True, "perturb_every": 0, **options}
    return [turn_of(answered, n_init, **settings) for answered in range(n_init, count)]


def test_the_process_waits_until_there_are_a_few_answers_and_then_has_every_second_turn():
    early, late = turns()[: FEW - N_INIT + 1], turns()[FEW - N_INIT :]
    assert set(early) == {Turn()}
    assert [turn.process for turn in late] == [False, True] * (len(late) // 2)


def test_after_a_long_start_it_does_not_wait():
    assert [turn.process for turn in turns(44, n_init=40)] == [False, True, False, True]


def test_what_is_turned_off_never_comes():
    assert set(turns(process=False)) == {Turn()}
    assert not any(turn.perturbed for turn in turns())


def test_margins_are_drawn_as_often_as_asked_among_the_other_proposals():
    expected = [True, False, False] * 20
    without = turns(process=False, perturb_every=3)
    assert [turn.perturbed for turn in without] == expected[: len(without)]
    others = [turn for turn in turns(perturb_every=3) if not turn.process]
    assert [turn.perturbed for turn in others] == expected[: len(others)]


@pytest.mark.parametrize("n_init", [1, 10, 20, 31])
def test_the_turns_of_the_process_are_counted(n_init):
    all_turns = turns(n_init=n_init)
    for before in range(len(all_turns)):
        had = sum(turn.process for turn in all_turns[:before])
        assert process_turns(n_init + before, n_init) == had
