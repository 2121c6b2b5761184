"""Experiments as bytes, and events as text: there and back unchanged, and nothing else is read."""

import json
import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from prefcal_env.errors import StudyError
from prefcal_env.experiments.experiment import Channel, Channels, End, Experiment
from prefcal_env.study import Created, Extended, Noted, Suggested, fold
from prefcal_env.study.fold import Event, decode, encode, from_text, pack, to_text, unpack
from support.studies import experiment

finite = st.floats(allow_nan=False, allow_infinity=False)
texts = st.text(max_size=8)
limits = st.one_of(st.just((-np.inf, np.inf)), st.just((-1.5, np.inf)), st.just((0.0, 2.0)))


@st.composite
def channels(draw, count):
    made = []
    for k in range(count):
        low, high = draw(limits)
        target = draw(st.none() | finite)
        made.append(
            Channel(f"{draw(texts)}{k}", draw(texts), low, high, target, draw(st.none() | finite.map(abs)))
        )
    return tuple(made)


@st.composite
def experiments(draw, depth=1):
    K, N = draw(st.integers(0, 5)), draw(st.integers(0, 3))
    n_x, n_u, n_y = (draw(st.integers(0, 2)) for _ in range(3))
    matrix = lambda *shape: draw(arrays(float, shape, elements=finite))  # noqa: E731
    runs = draw(st.lists(experiments(depth=depth - 1), max_size=2)) if depth else []
    return Experiment(
        theta=matrix(draw(st.integers(1, 3))),
        t=np.arange(K) * 0.1,
        x=matrix(K, n_x),
        u=matrix(K, n_u),
        t_control=matrix(N),
        u_control=matrix(N, n_u),
        y_ref=draw(arrays(float, (N, n_y))),
        iterations=draw(arrays(np.int64, N)),
        solve_time=matrix(N),
        solved=draw(arrays(bool, N)),
        end=draw(st.sampled_from(End)),
        channels=Channels(*(draw(channels(n)) for n in (n_x, n_u, n_y)), draw(texts)),
        kpis=draw(st.dictionaries(texts, st.floats())),
        signals={k: draw(arrays(float, K)) for k in draw(st.sets(texts, max_size=2))},
        runs=tuple(runs),
    )


@given(experiments())
def test_an_experiment_comes_back_bit_by_bit(made):
    content = encode(made)
    back = decode(content)
    assert encode(back) == content
    assert np.array_equal(back.solve_time, made.solve_time)
    assert decode(unpack(pack(content))).end is made.end
    assert list(back.kpis) == list(made.kpis)


@given(st.binary(max_size=200))
def test_other_bytes_are_refused(content):
    with pytest.raises(StudyError):
        decode(content)
    with pytest.raises(StudyError):
        decode(fold.MAGIC + content)


@given(st.data())
def test_damaged_bytes_are_refused_or_read_never_crash(data):
    content = bytearray(encode(experiment(0.5)))
    for _ in range(data.draw(st.integers(1, 4))):
        content[data.draw(st.integers(0, len(content) - 1))] = data.draw(st.integers(0, 255))
    cut = data.draw(st.integers(0, len(content)))
    for damaged in (bytes(content), bytes(content[:cut])):
        try:
            decode(damaged)
        except StudyError:
            continue


def test_a_bomb_is_not_unpacked(monkeypatch):
    monkeypatch.setattr(fold, "_MOST", 1000)
    assert unpack(pack(bytes(1000))) == bytes(1000)
    with pytest.raises(StudyError, match="too large"):
        unpack(pack(bytes(1_000_000)))
    with pytest.raises(StudyError, match="followed by something"):
        unpack(pack(b"a") + b"b")


@given(st.text(max_size=30))
def test_other_text_is_refused(text):
    with pytest.raises(StudyError, match="cannot be read"):
        from_text(text)


values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=3),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=3), inner, max_size=3),
    max_leaves=6,
)


@given(st.sampled_from(Event.__subclasses__()), st.data())
def test_wrong_fields_are_refused_or_fit_their_types(event_type, data):
    body = {name: data.draw(values) for name in event_type.__struct_fields__}
    try:
        event = from_text(json.dumps({"kind": event_type.__name__.lower(), **body}))
    except StudyError:
        return
    assert from_text(to_text(event)) == event


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ('{"kind": "surprise"}', r"'surprise' - at `\$.kind`"),
        ('{"text": "so"}', "missing required field `kind`"),
        ('{"kind": "noted"}', "missing required field `text`"),
        ('{"kind": "noted", "text": "so", "more": 1}', "unknown field `more`"),
        ('{"kind": "extended", "n_max": true}', r"Expected `int`, got `bool` - at `\$.n_max`"),
        ('{"kind": "suggested", "index": 0, "z": ["a"], "theta": []}', r"at `\$.z\[0\]`"),
    ],
)
def test_an_event_that_does_not_fit_is_refused_and_its_field_named(text, words):
    with pytest.raises(StudyError, match=f"an event cannot be read: .*{words}"):
        from_text(text)


@pytest.mark.parametrize(
    "event",
    [
        Noted(3),
        Extended("many"),
        Extended(2**63),
        Created({"weight": np.nan}),
        Created({"run": object()}),
        Suggested(0, (np.inf,), (0.0,)),
        Noted("half: \ud800"),
    ],
)
def test_what_could_not_be_read_back_is_refused(event):
    with pytest.raises(StudyError, match="cannot be recorded"):
        to_text(event)


def test_numbers_of_numpy_are_plain_data():
    event = Suggested(np.int64(0), (np.float64(0.1),), (np.float32(0.5),))
    assert from_text(to_text(event)) == Suggested(0, (0.1,), (0.5,))


def _with_outputs(y):
    return experiment(
        0.5,
        count=2,
        x=np.array([[1.0, 2.0], [3.0, 4.0]]),
        channels=Channels((Channel("a"), Channel("b")), (Channel("c"),), (Channel("d"),)),
        y=None if y is None else np.array(y)[:, None],
    )


@pytest.mark.parametrize(("y", "more"), [(None, 0), ([2.0, 4.0], 0), ([5.0, np.nan], 16)])
def test_outputs_come_back_and_those_that_are_states_need_no_room(y, more):
    made = _with_outputs(y)
    assert decode(encode(made)) == made
    headers = [struct.unpack_from("<I", encode(e), 8)[0] for e in (made, _with_outputs(None))]
    sizes = [len(encode(e)) for e in (made, _with_outputs(None))]
    assert (sizes[0] - headers[0]) - (sizes[1] - headers[1]) == more


def test_outputs_that_name_a_state_that_is_not_there_are_refused():
    content = encode(_with_outputs([2.0, 4.0])).replace(b'"y_states":[1]', b'"y_states":[7]')
    with pytest.raises(StudyError, match="outputs cannot be the states"):
        decode(content)
