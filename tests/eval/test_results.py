import json
from dataclasses import replace

import pytest
from hab_eval.errors import ResultError
from hab_eval.results import read_record, summarize, write_record
from hab_eval.schema import to_json
from refusals import check_each
from stub_runs import make_record


def test_the_published_form_of_a_file(tmp_path):
    path = tmp_path / "run.json"
    write_record(path, make_record())
    assert read_record(path) == make_record()
    data = json.loads(path.read_text())
    published = {"id", "scene", "success", "stages", "steps", "failure", "return", "scores"}
    assert set(data["episodes"][0]) == {*published, "seconds"}
    # 30 steps in 1 s.
    assert data["summary"]["seconds_per_step"] == pytest.approx(1 / 30)
    assert data["summary"]["failures"] == {"timeout": 1}
    assert data["summary"]["stages"]["pick_1"]["mean"] == 0.5
    assert data["summary"]["timings_s"] == {"plan": {"mean": 0.25, "max": 0.25, "n": 1}}
    for part in (*data["episodes"], data["summary"]):  # as written by older versions
        del part["scores"]
    path.write_text(json.dumps(data))
    assert read_record(path) == make_record()


def test_scores_are_averaged_over_all_episodes():
    """One of two episodes has 0.5; the other never started, and counts as 0."""
    first, second = make_record().episodes
    episodes = (replace(first, scores={"sct": 0.5}), second)
    assert summarize(episodes, {}).scores["sct"].mean == 0.25


BAD = (
    (lambda data: data.update(schema=2), "schema 2, this version reads 1"),
    (lambda data: data.pop("seed"), r"missing keys \['seed'\]"),
    (lambda data: data.update(extra=1), r"unknown keys \['extra'\]"),
    (lambda data: data["episodes"][1].update(steps="ten"), r"episodes\[1\]: steps: expected a val"),
    (lambda data: data["episodes"][0].update(seconds=None), "expected a number"),
    (lambda data: data["episodes"][1].update(id="e0"), "'e0' appears 2 times"),
    (lambda data: data["episodes"][0].update(failure="x"), "success True and failure 'x'"),
    (lambda data: data["summary"]["success"].update(mean=0.9), "success.mean does not follow"),
    (lambda data: data["summary"]["success"].update(ci95=[0.5]), "a list of 2"),
    (lambda data: data.update(episodes=[]), "episodes is empty"),
    (lambda data: data.update(seed=float("nan")), "NaN is not JSON"),
)


def test_bad_files_are_refused_with_their_place(tmp_path):
    path = tmp_path / "run.json"

    def check(case):
        edit, message = case
        data = to_json(make_record())
        edit(data)
        path.write_text(json.dumps(data))
        with pytest.raises(ResultError, match=message) as caught:
            read_record(path)
        assert str(caught.value).startswith(str(path))

    check_each({case[1]: case for case in BAD}, check)
    path.write_text("{")
    for unreadable in (path, tmp_path / "absent.json"):
        with pytest.raises(ResultError, match="cannot be read as JSON"):
            read_record(unreadable)
