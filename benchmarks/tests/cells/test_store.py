import contextlib
import json
import threading
import time
from dataclasses import replace

import pytest

from prefcal_bench.cells.cell import FORMAT, Cell, Result
from prefcal_bench.cells.duels import Duel, Round
from prefcal_bench.cells.store import Store, read_record, write_record
from prefcal_env.errors import BenchmarkError, SettingsError

CELL = Cell("RandomSearch", "camel", "perfect", 0, 1, 2)
RESULT = Result(CELL, ((0.1, -0.0), (1.0, 2.0)), (3.0, 0.5), (3.0, 0.5), (0, 1), (1.0, 2.0))
ROUND = Round("overtake", "lexicographic", 0, (("A", (1.0,)), ("B", (2.0,))))


@pytest.fixture
def store(tmp_path):
    return Store(tmp_path / "out")


def test_a_result_that_was_added_is_found_by_any_store_of_the_folder(store):
    assert store.find(CELL) == (None, "")
    store.add(RESULT)
    assert Store(store.folder).find(CELL) == (RESULT, "")
    assert store.find(replace(CELL, seed=1)) == (None, "")
    store.add(Result.failed(CELL, "no"))
    assert store.find(CELL)[0].failure == "no"
    assert len(list(store.path(CELL).parent.iterdir())) == 1


def test_duels_of_a_round_are_found_again(store):
    duels = (Duel("overtake", "lexicographic", "A", "B", 0, -1),)
    assert store.duels(ROUND) == (None, "")
    store.add_duels(ROUND, duels)
    assert store.duels(ROUND) == (duels, "")
    assert store.duels(replace(ROUND, thetas=(("A", (1.0,)), ("B", (3.0,))))) == (None, "")


def _half(text):
    return text[: len(text) // 2]


def _changed(text):
    return text.replace("0.5", "0.4", 1)


def _other_cell(text):
    return text.replace('"seed":0', '"seed":1')


@pytest.mark.parametrize(
    ("damage", "words"),
    [
        (_half, "cut off or no record"),
        (lambda text: "", "cut off or no record"),
        (lambda text: b"\xff\xfe\x00", "cut off or no record"),
        (lambda text: "\x00" * 40, "cut off or no record"),
        (_changed, "its checksum does not fit"),
        (_other_cell, "its checksum does not fit"),
        (lambda text: '{"title": "a letter"}', "not a record of the benchmark"),
        (lambda text: '{"format":1,"sha256":"","content":NaN}', "cut off or no record"),
        (lambda text: "[1, 2]", "not a record of the benchmark"),
    ],
)
def test_a_damaged_file_counts_as_absent_in_clear_words_and_is_replaced(store, damage, words):
    store.add(RESULT)
    path = store.path(CELL)
    content = damage(path.read_text())
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    found, trouble = store.find(CELL)
    assert found is None
    assert words in trouble
    assert str(path) in trouble
    store.add(RESULT)
    assert store.find(CELL) == (RESULT, "")


def test_a_sound_file_of_another_cell_or_of_no_cell_counts_as_absent(store):
    other = replace(CELL, seed=7)
    write_record(store.path(CELL), replace(RESULT, cell=other).to_dict())
    found, trouble = store.find(CELL)
    assert found is None
    assert "seed 7 in place of RandomSearch on camel, perfect, seed 0" in trouble
    write_record(store.path(CELL), {"not": "a result"})
    assert "a result must have" in store.find(CELL)[1]
    write_record(store.folder / "duels" / f"{ROUND.key}.json", [{"no": "duel"}])
    assert store.duels(ROUND)[0] is None


def test_a_file_of_a_newer_prefcal_is_refused_and_left_as_it_is(store):
    store.add(RESULT)
    path = store.path(CELL)
    newer = json.dumps(json.loads(path.read_text()) | {"format": FORMAT + 1})
    path.write_text(newer)
    with pytest.raises(BenchmarkError, match=f"format {FORMAT + 1}, this prefcal reads {FORMAT}:"):
        store.find(CELL)
    assert path.read_text() == newer


def test_what_cannot_be_read_or_written_says_so(store, tmp_path):
    store.path(CELL).mkdir()
    with pytest.raises(BenchmarkError, match="cannot read"):
        store.find(CELL)
    with pytest.raises(BenchmarkError, match="cannot write"):
        store.add(RESULT)
    assert not list(store.path(CELL).parent.glob(".*"))  # no half of it is left
    (tmp_path / "file").touch()
    with pytest.raises(SettingsError, match="is a file"):
        Store(tmp_path / "file")


def test_half_written_files_are_nobody_s_result(store):
    (store.path(CELL).parent / ".0123.half").write_text('{"format":1,')
    assert store.find(CELL) == (None, "")


def test_writers_at_the_same_time_leave_a_whole_file(tmp_path):
    path = tmp_path / "record.json"
    stop = threading.Event()

    def write(number):
        while not stop.is_set():
            write_record(path, [number] * 500)

    writers = [threading.Thread(target=write, args=(number,)) for number in (1, 2)]
    for writer in writers:
        writer.start()
    seen, until = set(), time.monotonic() + 20
    try:
        while len(seen) < 2:
            assert time.monotonic() < until
            with contextlib.suppress(FileNotFoundError):  # not even the first is there yet
                content = read_record(path)  # raises if it is half of one
                assert len(content) == 500
                assert len(set(content)) == 1
                seen.add(content[0])
    finally:
        stop.set()
        for writer in writers:
            writer.join()
