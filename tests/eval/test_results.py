import json
from dataclasses import replace

import pytest
from hab_eval.records.results import read_record, summarize, write_record
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
