"""Every experiment that a study speaks of is there, in a file that was sent by anybody too."""

import json

import numpy as np
import pytest

from prefcal_env.errors import StudyError
from prefcal_env.study import (
    Finished,
    Marked,
    Noted,
    StudyFile,
    Suggested,
    export_csv,
    export_json,
    import_json,
)
from support.interviews import clock
from support.studies import experiment, small_study

FOURTH = Suggested(4, (0.9,), (0.9,))


@pytest.mark.parametrize(
    "entries",
    [
        (FOURTH, Finished(4)),
        (FOURTH, Finished(4, same_as=9999)),
        (FOURTH, Finished(4, same_as=-1)),
        (FOURTH, Finished(4, same_as=2)),
        (FOURTH, (Finished(4, same_as=3), experiment(0.9))),
        ((Noted("with an experiment"), experiment(0.9)),),
        (Marked(0, "=cmd()", True),),
        (Noted("half a character: \ud800"),),
    ],
    ids=["none", "later", "negative", "no experiment there", "two", "a note's", "mark", "text"],
)
def test_an_event_that_cannot_be_is_refused_and_the_study_goes_on(entries):
    with small_study(":memory:") as file:
        state, events = file.state, list(file.events())
        with pytest.raises(StudyError):
            file.append(*entries)
        assert file.state == state
        assert list(file.events()) == events
        assert file.append(Noted("goes on")) == (len(events) + 1,)


def test_an_experiment_of_the_same_append_may_be_referred_to():
    with small_study(":memory:") as file:
        first = len(list(file.events())) + 1
        file.append(FOURTH, (Finished(4), experiment(0.9)), Finished(4, same_as=first + 1))
        assert file.experiment(file.state.finished[4]) == experiment(0.9)


def forged(*events):
    """Return an export of events, whatever they say."""
    rows = [
        {"seq": seq, "at": "now", "event": event, "payload": None}
        for seq, event in enumerate(events, start=1)
    ]
    return json.dumps({"prefcal study": 2, "events": rows})


def created(**configuration):
    return {"kind": "created", "configuration": {"n_max": 3} | configuration}


def suggested(z=0):
    return {"kind": "suggested", "index": 0, "z": [z], "theta": [0]}


def finished(same_as=None):
    return {"kind": "finished", "index": 0, "same_as": same_as}


HUGE = 10**400


@pytest.mark.parametrize(
    "events",
    [
        (),
        (created(), suggested(), finished()),
        (created(), suggested(), finished(2)),
        (created(), suggested(), finished(HUGE)),
        (created(), suggested(z=HUGE)),
        (created(), {"kind": "extended", "n_max": HUGE}),
        (created(n_max=True),),
        (created(weight=float("nan")),),
    ],
    ids=["none", "no experiment", "no source", "huge source", "huge z", "huge n_max", "bool", "NaN"],
)
def test_a_forged_export_is_refused_and_leaves_no_file(tmp_path, events):
    with pytest.raises(StudyError, match=r"not an exported study|damaged, nothing was imported"):
        import_json(forged(*events), tmp_path / "b.prefcal")
    assert list(tmp_path.iterdir()) == []


def test_half_a_character_in_an_export_is_refused(tmp_path):
    with small_study(":memory:") as file:
        text = export_json(file).replace('"at": "', '"at": "\\ud800', 1)
    with pytest.raises(StudyError, match="not an exported study"):
        import_json(text, tmp_path / "b.prefcal")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("knobs", [[1], 3, [{"name": "gain"}], "gain"])
def test_tables_of_a_strange_configuration_are_refused(tmp_path, knobs):
    path = import_json(forged(created(knobs=knobs)), tmp_path / "b.prefcal")
    with StudyFile.open(path, clock=clock()) as file, pytest.raises(StudyError, match="knobs"):
        export_csv(file, tmp_path / "tables")


def test_no_cell_of_the_tables_is_a_formula(tmp_path):
    with StudyFile.create(
        tmp_path / "a.prefcal", {"n_max": 3, "knobs": [{"name": "=A1", "unit": ""}]}, clock=lambda: "=NOW()"
    ) as file:
        made = experiment(0.5, kpis={"@sum": 1.0}, signals={"+gap": np.zeros(4)})
        file.append(Suggested(0, (0.5,), (0.5,)), (Finished(0), made))
        export_csv(file, tmp_path / "tables")
    cells = [
        cell
        for table in (tmp_path / "tables").rglob("*.csv")
        for line in table.read_text("utf-8").splitlines()
        for cell in line.split(",")
    ]
    assert {"'=A1", "'@sum", "'+gap"} <= set(cells)
    assert not [cell for cell in cells if cell.startswith(("=", "+", "@"))]
