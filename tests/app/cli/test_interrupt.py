"""Ctrl-C: when it stops at once, and when work is finished first."""

import contextlib
import signal
import threading

import pytest

from prefcal_app.cli.interrupt import interruption


def press():
    signal.raise_signal(signal.SIGINT)


def test_a_press_where_it_is_allowed_stops_at_once():
    with interruption() as ctrl_c:
        with pytest.raises(KeyboardInterrupt), ctrl_c.allowed():
            press()
        assert ctrl_c.pressed


def test_a_press_elsewhere_is_noted_and_comes_through_later():
    with interruption() as ctrl_c:
        press()
        assert ctrl_c.pressed
        with pytest.raises(KeyboardInterrupt), ctrl_c.allowed():
            pytest.fail("must not get here")


def test_a_press_that_was_swallowed_is_found_by_a_check():
    with interruption() as ctrl_c, ctrl_c.allowed():
        ctrl_c.check()
        with contextlib.suppress(KeyboardInterrupt):
            press()
        with pytest.raises(KeyboardInterrupt):
            ctrl_c.check()


def test_a_second_press_stops_whatever_is_going_on():
    with interruption():
        press()
        with pytest.raises(KeyboardInterrupt):
            press()


def test_a_press_is_answered_at_once_and_only_once():
    heard = []
    with interruption() as ctrl_c:
        ctrl_c.on_press = lambda: heard.append("heard")
        press()
        assert heard == ["heard"]
        with pytest.raises(KeyboardInterrupt):
            press()
        assert heard == ["heard"]


def test_a_terminal_that_is_gone_does_not_keep_a_study_from_ending():
    def gone():
        raise OSError(5, "Input/output error")

    with interruption() as ctrl_c:
        ctrl_c.on_press = gone
        press()
        assert ctrl_c.pressed


@pytest.mark.skipif(not hasattr(signal, "SIGHUP"), reason="no such signal here")
def test_a_closed_terminal_ends_a_study_as_ctrl_c_does():
    with interruption(others=True) as ctrl_c:
        signal.raise_signal(signal.SIGHUP)
        assert ctrl_c.pressed
    assert signal.getsignal(signal.SIGHUP) is signal.SIG_DFL


@pytest.mark.skipif(not hasattr(signal, "SIGHUP"), reason="no such signal here")
def test_what_the_user_lets_be_ignored_stays_ignored():
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)  # as nohup does
    try:
        with interruption(others=True) as ctrl_c:
            signal.raise_signal(signal.SIGHUP)
            assert not ctrl_c.pressed
    finally:
        signal.signal(signal.SIGHUP, before)


def test_the_handler_of_before_comes_back():
    before = signal.getsignal(signal.SIGINT)
    with interruption():
        assert signal.getsignal(signal.SIGINT) is not before
    assert signal.getsignal(signal.SIGINT) is before


def test_a_thread_that_may_not_set_handlers_gets_along_without():
    seen = []

    def work():
        with interruption() as ctrl_c:
            seen.append(ctrl_c.pressed)

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert seen == [False]
