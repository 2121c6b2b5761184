from prefcal_agents.schedule import Turn, turn_of


def turns(count=8, **options):
    settings = {"process": True, "perturb_every": 2, **options}
    return [turn_of(index, **settings) for index in range(count)]


def test_no_two_of_four_proposals_are_alike_and_then_it_starts_again():
    assert len(set(turns(4))) == 4
    assert turns(8)[4:] == turns(4)


def test_every_second_proposal_is_the_process_s_and_every_second_of_these_is_rough():
    assert [turn.process for turn in turns(6)] == [False, True] * 3
    assert [turn.rough for turn in turns(8) if turn.process] == [False, True] * 2
    assert not any(turn.perturbed for turn in turns() if turn.process)


def test_what_is_turned_off_never_comes():
    assert set(turns(process=False, perturb_every=0)) == {Turn()}
    assert not any(turn.perturbed for turn in turns(perturb_every=0))


def test_margins_are_drawn_as_often_as_asked_among_the_other_proposals():
    expected = [True, False, False, True, False, False, True]
    assert [turn.perturbed for turn in turns(7, process=False, perturb_every=3)] == expected
    others = [turn for turn in turns(14, perturb_every=3) if not turn.process]
    assert [turn.perturbed for turn in others] == expected
