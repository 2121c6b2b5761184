"""What the tests of the views share: interviews of the toy, and a panel to draw."""

from prefcal_app.session import Choice, Interview, Now, actions
from prefcal_env.experiments.experiment import Channel
from prefcal_env.experiments.panels import Plot
from support.interviews import begin, proceed
from toy_study import toy_scenario

toy, plain = toy_scenario(), toy_scenario("plain")
run, SPACE = toy.run, toy.space
LEVEL = Plot(Channel("level", "m", target=2.0, band=0.06, symbol="h"), "x", "level <h>")
VALVE = Plot(Channel("valve", "%", low=0.0, high=10.0), "u", "valve")
THETA = (0.4, 20.0, 1.0)
CHANNELS = run(THETA).channels


def asked(*choices: Choice, n_max: int = 6) -> tuple[Interview, Now]:
    """An interview of the toy after these answers, with its next question open."""
    interview = begin(toy, n_max=n_max)
    now = proceed(interview)
    for choice in choices:
        now = answer(interview, choice)
    return interview, now


def answer(interview: Interview, choice: Choice) -> Now:
    """Answer the open question, and work until the next one is."""
    question = interview.now().question
    assert question is not None
    interview.do(actions.Answer(question.id, choice, comment=f"said {choice.value}"))
    return proceed(interview)
