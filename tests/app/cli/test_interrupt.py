"""Ctrl-C: when it stops at once, and when work is finished first."""

import contextlib
import signal
import threading

import pytest

from prefcal_app.cli.calibrate import interruption

HANGS_UP = pytest.mark.skipif(not hasattr(signal, "SIGHUP"), reason="no such signal here")


def press(name="SIGINT"):
    signal.raise_signal(getattr(signal, name))


@pytest.fixture
def ctrl_c():
    before = signal.getsignal(signal.SIGINT)
    with interruption() as handler:
        assert signal.getsignal(signal.SIGINT) is handler
        yield handler
    assert signal.getsignal(signal.SIGINT) is before


def test_a_press_where_it_is_allowed_stops_at_once(ctrl_c):
    with pytest.raises(KeyboardInterrupt), ctrl_c.allowed():
        press()
    assert ctrl_c.pressed


def test_a_press_elsewhere_is_noted_and_comes_through_later(ctrl_c):
    press()
    assert ctrl_c.pressed
    with pytest.raises(KeyboardInterrupt), ctrl_c.allowed():
        pytest.fail("must not get here")


def test_a_press_that_was_swallowed_is_found_by_a_check(ctrl_c):
    with ctrl_c.allowed():
        ctrl_c.check()
        with contextlib.suppress(KeyboardInterrupt):
            press()
        with pytest.raises(KeyboardInterrupt):
            ctrl_c.check()


def test_the_first_press_is_answered_and_the_second_stops_whatever_is_going_on(ctrl_c):
    heard = []
    ctrl_c.on_press = lambda: heard.append("heard")
    press()
    assert heard == ["heard"]
    with pytest.raises(KeyboardInterrupt):
        press()
    assert heard == ["heard"]


def test_a_terminal_that_is_gone_does_not_keep_a_study_from_ending(ctrl_c):
    def gone():
        raise OSError(5, "Input/output error")

    ctrl_c.on_press = gone
    press()
    assert ctrl_c.pressed


@HANGS_UP
@pytest.mark.parametrize("before", [signal.SIG_DFL, signal.SIG_IGN])  # ignored, as nohup does
def test_a_closed_terminal_ends_a_study_as_ctrl_c_does_unless_the_user_ignores_it(before):
    earlier = signal.signal(signal.SIGHUP, before)
    try:
        with interruption(others=True) as ctrl_c:
            press("SIGHUP")
            assert ctrl_c.pressed == (before is signal.SIG_DFL)
        assert signal.getsignal(signal.SIGHUP) is before
    finally:
        signal.signal(signal.SIGHUP, earlier)


def test_a_thread_that_may_not_set_handlers_gets_along_without():
    seen = []

    def work():
        with interruption() as ctrl_c:
            seen.append(ctrl_c.pressed)

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert seen == [False]
