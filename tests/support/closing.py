"""A page in place of the window, for commands that end when a person closes it."""

from prefcal_app.session import Choice, Phase, actions


class AnsweringPage:
    """Answers all questions at the first look of the command; each look is a turn."""

    warning = link_for_others = ""
    link, verifying, reports = "http://127.0.0.1/", False, None

    def __init__(self, interview, **_):
        self.interview, self.closed, self.turn = interview, self, 0

    def __enter__(self):
        return self

    def __exit__(self, *_):
        return None

    def away(self):
        return None

    def until(self, ready):
        now = self.interview.now()
        while not ready(now):
            now = self.interview.wait(now.version, 60.0)
        return now

    def answer(self):
        def ready(now):
            return now.question is not None or now.phase is Phase.OVER

        while (now := self.until(ready)).phase is not Phase.OVER:
            self.interview.do(actions.Answer(now.question.id, Choice.LEFT))
