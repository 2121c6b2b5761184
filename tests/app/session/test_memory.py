"""What an agent learned stays beside the study: it saves time and changes nothing."""

import shutil

import pytest

from prefcal_agents.glisp import fits
from prefcal_app.session import Choice, actions
from prefcal_env.study import verify
from support.interviews import begin, judge, proceed, reopened
from toy_study import toy_scenario

ANSWERS = 11


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


def next_ones(path):
    """The next two θ and pairs of a study, and how many stages were learned anew for them."""
    anew = []
    following = fits._following

    def counted(seed, past, *rest):
        anew.append(past.answered)
        return following(seed, past, *rest)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(fits, "_following", counted)
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


def test_a_record_that_changed_uses_only_what_still_holds(study, undisturbed):
    """A retraction changes what every later answer teaches."""
    alone = study.with_name("alone.prefcal")
    shutil.copy(study, alone)
    for path in (study, alone):
        interview = reopened(toy_scenario(), path)
        interview.do(actions.Retract(1))
        interview.file.close()  # and killed before anything was kept
    found, anew = next_ones(study)
    assert found == next_ones(alone)[0]
    assert min(anew) == 1


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
