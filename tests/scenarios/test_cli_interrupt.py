"""Ctrl-C: when it stops at once, and when work is finished first."""

import contextlib
import signal
import threading

import pytest

from prefcal_scenarios.cli.interrupt import interruption


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
