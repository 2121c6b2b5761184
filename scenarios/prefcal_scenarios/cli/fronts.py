"""Where a person is asked: in the query window, or in the terminal."""

from dataclasses import dataclass

from rich.console import Console

from prefcal_scenarios.cli.interrupt import Interruption
from prefcal_scenarios.cli.sitting import Sitting
from prefcal_scenarios.interview import Background, Phase

GONE = 20.0
"""Seconds after the last page was closed at which a study that is over ends the command."""


@dataclass(frozen=True, slots=True)
class Front:
    """How a person wants to be asked.

    Args:
        terminal: In the terminal, without a page.
        browser: Whether a browser is opened.
        host: Address to serve on.
        port: Port to serve on; 0 takes a free one.
    """

    terminal: bool = False
    browser: bool = True
    host: str = "127.0.0.1"
    port: int = 0

    def check(self) -> None:
        """Raise SettingsError if the page cannot be served there."""
        from prefcal_scenarios.window.binding import bind

        bind(self.host, self.port).close()


def in_window(sitting: Sitting, front: Front, ctrl_c: Interruption) -> bool:
    """Serve the query window until it is closed; whether the study is over by then."""
    # Here, not above: unattended runs must not wait for a web server.
    from prefcal_scenarios.window import Window, open_browser

    interview, told = sitting.interview, False
    with Window(
        interview, host=front.host, port=front.port, again=sitting.again,
        command=sitting.opened.options.command(),
    ) as window, Background(interview):  # fmt: skip
        if window.warning:
            sitting.say(window.warning)
        _print_link(window.link, sitting)
        if window.link_for_others:
            sitting.say("From other machines:")
            _print_link(window.link_for_others, sitting)
        if front.browser and not open_browser(window.link):
            sitting.say("No browser found: open the link yourself, or answer here with --terminal.")
        try:
            with ctrl_c.allowed():
                while not window.closed.wait(0.1):
                    over = interview.now().phase is Phase.OVER
                    if over and not told:
                        record = sitting.write()
                        window.reports = sitting.folder
                        if not sitting.json:
                            sitting.tell(record)
                        sitting.say(
                            "The study is over. This ends when you close its page, or with Ctrl-C."
                        )
                    told = over
                    ctrl_c.on_press = sitting.closing if told else sitting.stopping
                    away = window.away()
                    if over and away is not None and away > GONE:
                        break
        except KeyboardInterrupt:
            pass
    if sitting.json or not told:
        sitting.tell(sitting.write())
    return interview.now().phase is Phase.OVER


def _print_link(link: str, sitting: Sitting) -> None:
    """Alone on its line, unwrapped and at once: programs read it."""
    stream = sitting.messages.file if sitting.json else None
    print(link, file=stream, flush=True)


def in_terminal(sitting: Sitting, front: Front, ctrl_c: Interruption) -> bool:
    """Ask in the terminal until the person stops; whether the study is over by then."""
    from prefcal_scenarios.terminal import converse, keys_of

    # With --json, standard output belongs to the result.
    console = sitting.messages if sitting.json else Console()
    interview = sitting.interview
    with Background(interview):
        try:
            with ctrl_c.allowed():
                converse(interview, console, keys_of(console))
        except KeyboardInterrupt:
            pass
    sitting.tell(sitting.write())
    return interview.now().phase is Phase.OVER
