"""What an agent learned stays beside the study: it saves time and changes nothing."""

import shutil
from contextlib import contextmanager
from importlib.metadata import PackageNotFoundError, version
from types import SimpleNamespace

import pytest

from prefcal_agents import GLISp, GLISpSettings
from prefcal_agents.glisp import fits
from prefcal_agents.screening.bank import Growth
from prefcal_app.session import Choice, actions, driver
from prefcal_env.study import StudyFile, verify
from support.interviews import begin, clock, judge, proceed, reopened, worked
from support.screened import screening, simulated
from toy_study import toy_scenario

ANSWERS, KEPT = 11, 10


@pytest.fixture(scope="module")
def kept(tmp_path_factory):
    """A study of eleven answers that was closed with what its agent had learned beside it."""
    path = tmp_path_factory.mktemp("kept") / "mine.prefcal"
    interview = begin(toy_scenario(), n_max=20, path=path)
    while interview.now().state.history.answered < ANSWERS:
        question = proceed(interview).question
        interview.do(actions.Answer(question.id, judge(question, interview.scenario.cost)))
    proceed(interview)
    interview.close()
    interview.file.close()
    return path


@pytest.fixture
def study(kept, tmp_path):
    for path in (kept, kept.with_suffix(".learned")):
        shutil.copy(path, tmp_path)
    return tmp_path / kept.name


@contextmanager
def counting():
    """The number of answers of each stage that is learned anew meanwhile."""
    anew = []
    following = fits._follow

    def counted(seed, past, *rest):
        anew.append(past.answered)
        return following(seed, past, *rest)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(fits, "_follow", counted)
        yield anew


def next_ones(path):
    """The next two θ and pairs of a study, and how many stages were learned anew for them."""
    with counting() as anew:
        interview, found = reopened(toy_scenario(), path), []
        for _ in range(2):
            question = proceed(interview).question
            theta = interview.now().state.history.samples[question.challenger.index].theta
            found.append((theta, question.incumbent.index))
            interview.do(actions.Answer(question.id, Choice.LEFT))
        interview.close()
        interview.file.close()
    assert verify(path) == ()
    return found, anew


@pytest.fixture(scope="module")
def undisturbed(kept, tmp_path_factory):
    alone = shutil.copy(kept, tmp_path_factory.mktemp("alone"))
    found, anew = next_ones(type(kept)(alone))
    assert min(anew) == 1
    return found


def test_a_long_study_goes_on_as_if_nothing_were_kept_and_learns_only_what_is_new(study, undisturbed):
    found, anew = next_ones(study)
    assert found == undisturbed
    assert min(anew) > ANSWERS


def test_what_is_damaged_is_learned_anew_and_written_again(study, undisturbed):
    path = study.with_suffix(".learned")
    whole = path.read_bytes()
    path.write_bytes(whole[:500] + bytes([whole[500] ^ 1]) + whole[501:])
    found, anew = next_ones(study)
    assert found == undisturbed
    assert min(anew) == 1
    assert min(next_ones(study)[1]) > ANSWERS


def test_after_a_retraction_nothing_holds_that_was_learned_of_later_answers(study):
    """It changes what every later answer teaches."""
    alone = study.with_name("alone.prefcal")
    shutil.copy(study, alone)
    for path in (study, alone):
        interview = reopened(toy_scenario(), path)
        interview.do(actions.Retract(1))
        interview.file.close()  # and killed before anything was kept
    found, anew = next_ones(study)
    assert found == next_ones(alone)[0]
    assert min(anew) == 1


def test_after_an_undo_what_was_learned_of_the_answers_before_still_holds(study):
    alone = study.with_name("alone.prefcal")
    shutil.copy(study, alone)
    for path in (study, alone):
        interview = reopened(toy_scenario(), path)
        interview.do(actions.Undo(interview.now().version))
        question = interview.now().question
        interview.do(actions.Answer(question.id, Choice.SAME))  # another answer than the one undone
        interview.file.close()
    found, anew = next_ones(study)
    assert found == next_ones(alone)[0]
    assert min(anew) > ANSWERS - 1


class LearnsError(Exception):
    """Something is learned anew."""


def learns_anew(path, **changed):
    """Whether an agent learns anything anew after the record of a study, at other settings."""

    def learns(*given):
        raise LearnsError

    settings = {"n_init": 3, "n_max": 20, "seed": 0, **changed}
    with StudyFile.open(path, clock=clock()) as file, pytest.MonkeyPatch.context() as patch:
        patch.setattr(fits, "_follow", learns)
        agent = GLISp(toy_scenario().space, **settings)
        agent.history = file.state.history
        driver.Memory(file).recall(agent)
        try:
            agent.propose(agent.history)
        except LearnsError:
            return True
    return False


OTHERS = {
    "version": ("prefcal_agents.GLISp.version", GLISp.version + 1),
    "a library": (
        "prefcal_app.session.driver.version",
        lambda name: "0" if name == "scipy" else version(name),
    ),
    "processor": ("platform.machine", lambda: "vax"),
    "code": ("prefcal_app.session.driver._digest_code", lambda: b"of another commit"),
}


@pytest.mark.parametrize(("place", "value"), OTHERS.values(), ids=OTHERS)
def test_what_was_learned_by_another_version_or_machine_is_learned_anew(study, monkeypatch, place, value):
    assert not learns_anew(study)
    monkeypatch.setattr(place, value)
    assert learns_anew(study)


@pytest.mark.parametrize(
    "changed",
    [{"seed": 1}, {"n_init": 4}, {"settings": GLISpSettings(error_rate=0.2)}],
    ids=["seed", "n_init", "error_rate"],
)
def test_what_was_learned_with_other_settings_is_learned_anew(study, changed):
    assert learns_anew(study, **changed)


@pytest.mark.parametrize(
    "changed",
    [{"n_max": 30}, {"settings": GLISpSettings(questions_per_experiment=3)}],
    ids=["n_max", "questions"],
)
def test_what_was_learned_holds_however_many_questions_are_to_come(study, changed):
    assert not learns_anew(study, **changed)


def test_the_code_that_learns_is_told_apart_by_what_is_in_it(tmp_path, monkeypatch):
    (tmp_path / "fit.py").write_text("HALF = 0.5")
    monkeypatch.setattr("prefcal_env.qp.__path__", [str(tmp_path)])
    before = driver._digest_code.__wrapped__()
    assert driver._digest_code.__wrapped__() == before
    (tmp_path / "fit.py").write_text("HALF = 0.6")
    assert driver._digest_code.__wrapped__() != before


def test_a_checkout_that_is_not_installed_keeps_what_it_learns(study, monkeypatch):
    def missing(name):
        raise PackageNotFoundError(name)

    monkeypatch.setattr("prefcal_app.session.driver.version", missing)
    assert min(next_ones(study)[1]) == 1
    assert min(next_ones(study)[1]) > ANSWERS


def test_a_study_opens_though_its_agent_cannot_recall(study, undisturbed, monkeypatch):
    def fails(agent, learned):
        raise ValueError("this agent is somebody's own")

    monkeypatch.setattr(GLISp, "recall", fails)
    assert next_ones(study)[0] == undisturbed


def test_a_study_in_memory_reads_no_file(study, monkeypatch):
    with StudyFile.open(study, clock=clock()) as file:
        in_memory = SimpleNamespace(path=":memory:", state=file.state)
    monkeypatch.setattr(driver, "read_learned", lambda path, key: pytest.fail(f"{path} was read"))
    driver.Memory(in_memory).recall(GLISp(toy_scenario().space, n_init=3, n_max=20, seed=0))


def test_what_is_learned_is_kept_while_a_question_is_open(tmp_path):
    path = tmp_path / "mine.prefcal"
    interview = begin(toy_scenario(), n_max=20, path=path)
    while interview.now().state.history.answered < KEPT:
        interview.do(actions.Answer(proceed(interview).question.id, Choice.LEFT))
    proceed(interview)
    assert not path.with_suffix(".learned").exists()
    assert interview.work()
    assert path.with_suffix(".learned").exists()
    assert not interview._driver.memory.is_due(interview._driver.agent)
    interview.file.close()  # as if it were killed: nothing closes the interview
    assert min(next_ones(path)[1]) > KEPT


def test_what_was_kept_outlasts_a_session_without_an_answer(study, undisturbed):
    interview = reopened(toy_scenario(), study)
    interview.close()
    interview.file.close()
    found, anew = next_ones(study)
    assert found == undisturbed
    assert min(anew) > ANSWERS


def test_what_is_missing_is_kept_at_the_next_question(study):
    study.with_suffix(".learned").unlink()
    interview = reopened(toy_scenario(), study)
    worked(interview)
    assert study.with_suffix(".learned").exists()
    interview.close()
    interview.file.close()


def test_runs_are_stopped_before_anything_is_kept(study, monkeypatch):
    """A second Ctrl-C may come while it is, and a plant must not wait."""
    interview = reopened(toy_scenario(), study)
    stopped = []
    monkeypatch.setattr(interview._driver.underway, "stop", stopped.append)

    def interrupted(agent):
        assert stopped
        assert interview.is_closed
        raise KeyboardInterrupt

    monkeypatch.setattr(interview._driver.memory, "keep", interrupted)
    with pytest.raises(KeyboardInterrupt):
        interview.close()
    interview.close()
    interview.file.close()


def test_a_study_does_not_mind_that_nothing_can_be_kept(study, undisturbed, monkeypatch):
    def fails(path, content):
        raise OSError(28, "No space left on device")

    before = study.with_suffix(".learned").read_bytes()
    monkeypatch.setattr("pathlib.Path.write_bytes", fails)
    assert next_ones(study)[0] == undisturbed
    assert study.with_suffix(".learned").read_bytes() == before
    assert {path.name for path in study.parent.iterdir()} == {"mine.prefcal", "mine.learned"}


def test_nothing_is_kept_of_a_short_study_or_of_one_that_is_only_read(tmp_path):
    interview = begin(toy_scenario(), path=tmp_path / "mine.prefcal")
    proceed(interview)
    interview.close()
    interview.file.close()
    assert [path.name for path in tmp_path.iterdir()] == ["mine.prefcal"]


def test_a_study_that_simulates_recalls_its_stages_too(tmp_path, monkeypatch):
    path, alone = tmp_path / "mine.prefcal", tmp_path / "alone.prefcal"
    interview = screening(n_max=20, path=path)
    while interview.now().state.history.answered < ANSWERS:
        question = proceed(interview).question
        interview.do(actions.Answer(question.id, judge(question, interview.scenario.cost)))
    interview.close()
    interview.file.close()
    shutil.copy(path, alone)  # without what was learned

    def next_one(study):
        again = reopened(simulated, study)
        theta = proceed(again).state.history.samples[ANSWERS].theta
        again.close()
        again.file.close()
        return theta

    expected, following, anew = next_one(alone), Growth._follow, []
    monkeypatch.setattr(
        Growth, "_follow", lambda g, past, *rest: (anew.append(past.answered), following(g, past, *rest))[1]
    )
    assert next_one(path) == expected
    assert anew == [ANSWERS]  # the study was closed before anything followed from the last answer
