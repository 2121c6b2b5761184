from prefcal_agents.schedule import Turn, turn_of


def turns(count=8, **options):
    settings = {"kernel": True, "perturb_every": 2, "local": True, **options}
    return [turn_of(index, **settings) for index in range(count)]


def test_no_two_of_four_proposals_are_alike():
    assert len(set(turns(4))) == 4
    assert turns(8)[4:] == turns(4)


def test_each_surrogate_perturbs_once_and_is_local_once_in_four():
    for kernel in (True, False):
        mine = [turn for turn in turns(4) if turn.kernel == kernel]
        assert sorted(turn.perturbed for turn in mine) == [False, True]
        assert sorted(turn.local for turn in mine) == [False, True]


def test_what_is_turned_off_never_comes():
    assert set(turns(kernel=False, perturb_every=0, local=False)) == {Turn(False, False, False)}


def test_margins_are_drawn_as_often_as_asked_whatever_else_takes_turns():
    assert [turn.perturbed for turn in turns(7, perturb_every=3)] == [
        True, False, False, True, False, False, True,
    ]  # fmt: skip
