import json
from dataclasses import replace

import pytest
from hab_eval.errors import ResultError
from hab_eval.results import read_record, summarize, write_record
from hab_eval.schema import to_json
from stub_runs import make_record


def write_edited(path, edit):
    data = to_json(make_record())
    edit(data)
    path.write_text(json.dumps(data))


def test_round_trip(tmp_path):
    path = tmp_path / "run.json"
    write_record(path, make_record())
    assert read_record(path) == make_record()
    assert [entry.name for entry in tmp_path.iterdir()] == ["run.json"]


def test_file_has_the_published_form(tmp_path):
    write_record(tmp_path / "run.json", make_record())
    data = json.loads((tmp_path / "run.json").read_text())
    assert data["schema"] == 1
    published = {"id", "scene", "success", "stages", "steps", "failure", "return", "scores"}
    assert set(data["episodes"][0]) == {*published, "seconds"}
    assert set(data["summary"]["success"]) == {"mean", "n", "ci95"}
    # 30 steps in 1 s.
    assert data["summary"]["seconds_per_step"] == pytest.approx(1 / 30)
    assert data["summary"]["failures"] == {"timeout": 1}
    assert data["summary"]["stages"]["pick_1"]["mean"] == 0.5
    assert data["summary"]["timings_s"] == {"plan": {"mean": 0.25, "max": 0.25, "n": 1}}


def test_scores_are_averaged_over_all_episodes(tmp_path):
    """One of two episodes has 0.5; the other never started, and counts as 0."""
    record = make_record()
    first, second = record.episodes
    episodes = (replace(first, scores={"sct": 0.5}), second)
    record = replace(record, episodes=episodes, summary=summarize(episodes, record.timings_s))
    write_record(tmp_path / "run.json", record)
    assert read_record(tmp_path / "run.json").summary.scores["sct"].mean == 0.25


def test_files_without_scores_can_be_read(tmp_path):
    """As written by older versions."""
    path = tmp_path / "run.json"
    write_record(path, make_record())
    data = json.loads(path.read_text())
    for part in (*data["episodes"], data["summary"]):
        del part["scores"]
    path.write_text(json.dumps(data))
    assert read_record(path) == make_record()


@pytest.mark.parametrize(
    ("edit", "message"),
    [
        (lambda data: data.update(schema=2), "schema 2, this version reads 1"),
        (lambda data: data.pop("seed"), r"missing keys \['seed'\]"),
        (lambda data: data.update(extra=1), r"unknown keys \['extra'\]"),
        (
            lambda data: data["episodes"][1].update(steps="ten"),
            r"episodes\[1\]: steps: expected a value of type int, got \"ten\"",
        ),
        (lambda data: data["episodes"][0].update(steps=True), "expected a value of type int"),
        (lambda data: data["episodes"][0].update(seconds=None), "expected a number"),
        (lambda data: data["episodes"][1].update(id="e0"), "'e0' appears 2 times"),
        (lambda data: data["episodes"][0].update(failure="x"), "success True and failure 'x'"),
        (
            lambda data: data["summary"]["success"].update(mean=0.9),
            "summary.success.mean does not follow",
        ),
        (lambda data: data["summary"]["success"].update(ci95=[0.5]), "a list of 2"),
        (lambda data: data.update(episodes=[]), "episodes is empty"),
        (lambda data: data.update(seed=float("nan")), "NaN is not JSON"),
    ],
)
def test_bad_files_are_refused_with_their_place(tmp_path, edit, message):
    path = tmp_path / "run.json"
    write_edited(path, edit)
    with pytest.raises(ResultError, match=message) as caught:
        read_record(path)
    assert str(caught.value).startswith(str(path))


def test_no_json_at_all(tmp_path):
    path = tmp_path / "run.json"
    path.write_text("{")
    with pytest.raises(ResultError, match="cannot be read as JSON"):
        read_record(path)
    with pytest.raises(ResultError, match="cannot be read as JSON"):
        read_record(tmp_path / "absent.json")
