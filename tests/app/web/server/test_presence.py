"""How long no page has been open: the study that is over waits for one."""

from prefcal_app.web.server.serve import Presence


def at(seconds):
    """A presence whose clock stands at `seconds[0]`."""
    return Presence(lambda: seconds[0])


def test_before_the_first_page_nobody_has_gone_away():
    now = [0.0]
    presence = at(now)
    now[0] = 1e6
    assert presence.away() is None


def test_away_counts_from_the_last_sign_of_a_page():
    now = [100.0]
    presence = at(now)
    presence.seen(True)
    now[0] = 110.0
    assert presence.away() == 10.0
    presence.seen(True)
    assert presence.away() == 0.0


def test_a_page_in_a_hidden_tab_may_be_silent_for_a_minute():
    now = [0.0]
    presence = at(now)
    presence.seen(False)
    now[0] = 65.0
    assert presence.away() == 0.0
    now[0] = 95.0
    assert presence.away() == 25.0
