"""Invalid result files, journals and configurations: the error names file, episode and field."""

import copy
import json
import math
import os

import pytest
import stub_runs  # first: it finds the stub
from hab_eval.cli import main
from hab_eval.config import read_config
from hab_eval.results import EpisodeResult, FinishedEpisode, read_record, summarize
from hab_eval.run_folder import RunFolder
from hab_eval.schema import to_json
from hab_eval.stats import Estimate
from refusals import check_each, refused_by_call, refused_by_command
from stub_runs import make_record

NAN, INF, HUGE = math.nan, math.inf, 10**400
SURROGATE = "half \ud800 of a pair"

WRONG = {
    "str": (5, None, ["x"], SURROGATE),
    "name": (5, None, "", " ", SURROGATE),
    "bool": (1, None, "true"),
    "count": (-1, 1.0, "1", None, True, HUGE, NAN, 2**63),
    "seconds": (-0.5, "1", None, True, HUGE, NAN, INF),
    "number": ("1", None, False, HUGE, -1e308, NAN, INF),
    "flags": (None, [], {"a": 1}, {SURROGATE: True}),
    "texts": (None, [], {"a": 1}, {"a": SURROGATE}),
    "failure": (5, "", "  ", SURROGATE),
    "numbers": (None, [], 1, {"sct": "1"}, {"sct": None}, {"sct": NAN}, {"sct": HUGE}),
    "durations": (None, [], 1, {"plan": -1}, {"plan": "1"}, {"plan": NAN}, {"plan": HUGE}),
}
"""Kind of a field -> values that it does not take."""

OF_EPISODE = {
    "id": "name",
    "scene": "str",
    "success": "bool",
    "stages": "flags",
    "steps": "count",
    "failure": "failure",
    "return": "number",
    "scores": "numbers",
    "seconds": "seconds",
}

OF_RECORD = {
    "agent": "name",
    "agent_name": "name",
    "privileged": "bool",
    "control_mode": "str",
    "obs_mode": "str",
    "target_frame": "str",
    "handle_position": "bool",
    "env": "name",
    "scene_dataset": "name",
    "split": "str",
    "seed": "count",
    "options": "texts",
    "versions": "texts",
    "device": "str",
}

OF_CONFIG = {"agent": "str", "env": "str", "episodes": "count", "seed": "count", "options": "texts"}


GOOD = to_json(make_record())
LINE = to_json(FinishedEpisode(episode=make_record().episodes[1], timings_s={"plan": 0.25}))
CONFIG = {
    "config": {"agent": "a:b", "env": "HabPick-v1", "scene_dataset": "apartment", "objects": None}
    | {"split": None, "episodes": 2, "seed": 0, "novel": None, "options": {}},
    "versions": {"python": "3.11"},
    "git": None,
}


def wrong_values(fields):
    """Name -> (field, value) of each value that a field does not take."""
    return {
        f"{field} {value!r:.40}": (field, value)
        for field, kind in fields.items()
        for value in WRONG[kind]
    }


def written(path, value):
    path.write_text(value if isinstance(value, str) else json.dumps(value))
    return path


@pytest.fixture
def record_refused(tmp_path):
    """Asserts that a record is refused."""

    def refused(data, *words):
        path = written(tmp_path / "run.json", data)
        refused_by_call(lambda: read_record(path), str(path), *words)

    return refused


def test_the_good_files_are_good(tmp_path):
    assert read_record(written(tmp_path / "run.json", GOOD)) == make_record()
    assert read_config(written(tmp_path / "config.json", CONFIG)).config.episodes == 2
    written(tmp_path / "episodes.jsonl", json.dumps(LINE) + "\n")
    assert list(RunFolder(root=tmp_path).read_journal()) == ["e1"]


def test_a_wrong_field_of_a_record_is_named(record_refused):
    def of_record(case):
        field, value = case
        record_refused({**GOOD, field: value}, f"run.json: {field}")

    def of_episode(case):
        field, value = case
        data = copy.deepcopy(GOOD)
        data["episodes"][1][field] = value
        record_refused(data, "episodes[1]", f": {field}", "e1" if field != "id" else "episodes[1]")

    check_each(wrong_values(OF_RECORD), of_record)
    check_each(wrong_values(OF_EPISODE), of_episode)
    durations = {repr(value)[:40]: value for value in WRONG["durations"]}
    check_each(
        durations, lambda v: record_refused({**GOOD, "timings_s": {"e1": v}}, "timings_s.e1")
    )


def test_a_wrong_field_of_a_journal_is_named(tmp_path):
    def check(case):
        field, value = case
        line = copy.deepcopy(LINE)
        (line if field == "timings_s" else line["episode"])[field] = value
        path = written(tmp_path / "episodes.jsonl", json.dumps(line) + "\n")
        words = (str(path), "line 1", field, "e1" if field != "id" else "line 1")
        refused_by_call(RunFolder(root=tmp_path).read_journal, *words)

    check_each(wrong_values({**OF_EPISODE, "timings_s": "durations"}), check)


def test_a_wrong_field_of_a_configuration_is_named(tmp_path):
    def check(case):
        field, value = case
        config = {**CONFIG, "config": {**CONFIG["config"], field: value}}
        path = written(tmp_path / "config.json", config)
        refused_by_call(lambda: read_config(path), str(path), field)

    check_each(wrong_values(OF_CONFIG), check)


def edit_of(**changes):
    return {**GOOD, **changes}


CONTRADICTIONS = {
    "schema_true": (edit_of(schema=True), "schema"),
    "schema_text": (edit_of(schema="1"), "schema"),
    "no_episodes": (edit_of(episodes=[]), "episodes is empty"),
    "episodes_dict": (edit_of(episodes={}), "episodes"),
    "episode_list": (edit_of(episodes=[[]]), "episodes[0]"),
    "twice": (edit_of(episodes=[GOOD["episodes"][0]] * 2), "'e0' appears 2 times"),
    "foreign_timing": (edit_of(timings_s={"e9": {}}), "timings_s: unknown episode"),
    "summary_none": (edit_of(summary=None), "summary"),
    "extra_keys": (edit_of(**{f"key{i}": 1 for i in range(5000)}), "unknown keys", "4995 more"),
    "long_key": (edit_of(**{"k" * 100_000: 1}), "unknown keys"),
    "long_value": (edit_of(seed="x" * 100_000), "seed"),
    "list": ([GOOD], "schema"),
    "text": ('"run"', "schema"),
    "empty": ("", "JSON"),
    "torn": (json.dumps(GOOD)[:-20], "JSON"),
    "nan_outside": ("NaN", "schema"),
    "deep_lists": ("[" * 200_000 + "]" * 200_000, "nested too deeply"),
    "deep_field": ('{"schema": 1, "agent": ' + "[" * 200_000 + "]" * 200_000 + "}", "deeply"),
    "digits": ('{"schema": ' + "1" * 5000 + "}", "JSON"),
    "twice_key": ('{"schema": 1, "schema": 1}', 'duplicate key "schema"'),
    "single_quotes": ("{'schema': 1}", "JSON"),
}


NO_TEXT = (
    b'{"schema": 1, "agent": "\xe9"}',
    json.dumps(GOOD).encode("utf-16"),
    bytes(range(256)),
    b"\xef\xbb\xbf" + json.dumps(GOOD).encode(),
)


def test_a_record_that_is_none_is_refused_with_its_reason(tmp_path, record_refused):
    def no_text(data):
        (tmp_path / "run.json").write_bytes(data)
        refused_by_call(lambda: read_record(tmp_path / "run.json"), "cannot be read as JSON")

    check_each(CONTRADICTIONS, lambda case: record_refused(*case))
    check_each({repr(data)[:30]: data for data in NO_TEXT}, no_text)
    data = copy.deepcopy(GOOD)
    data["episodes"][1]["stages"] = {"place_1": False}  # of another task
    record_refused(data, "'e1'", "place_1", "'e0'")


def test_a_path_that_is_no_file_is_refused_at_once(tmp_path):
    def check(name):
        refused_by_call(lambda: read_record(tmp_path / name), "cannot be read as JSON")

    (tmp_path / "folder").mkdir()
    os.mkfifo(tmp_path / "fifo")  # reading it would wait for ever
    (tmp_path / "file").write_text("")
    names = ("absent", "folder", "fifo", "file/run.json", "x" * 300, "a\0b")
    check_each({repr(name): name for name in names}, check)
    arguments = ("failures", tmp_path / "fifo", "--out", tmp_path / "x.png")
    refused_by_command(main, arguments, "fifo", "not a regular file")


CONTRADICTION = {**LINE, "episode": {**LINE["episode"], "id": "e2", "success": True}}
JOURNALS = {
    "blank_line": (b"\n", "line 2", "JSON"),
    "text": (b"x\n", "line 2", "JSON"),
    "list": (b"[]\n", "line 2", "an object"),
    "deep": (b"[" * 200_000 + b"\n", "line 2", "nested too deeply"),
    "twice": (json.dumps(LINE).encode() + b"\n", "line 2", "'e1' appears twice"),
    "twice_key": (b'{"episode": 1, "episode": 2}\n', "line 2", "duplicate key"),
    "extra": (json.dumps({**LINE, "more": 1}).encode() + b"\n", "line 2", "unknown keys"),
    "contradiction": (json.dumps(CONTRADICTION).encode() + b"\n", "line 2", "'e2'", "success True"),
    "no_text": (b"\xff\xfe\n", "line 2", "UTF-8"),
}


def test_a_bad_line_of_a_journal_is_named(tmp_path):
    path = tmp_path / "episodes.jsonl"

    def check(case):
        bad, *words = case
        path.write_bytes(json.dumps(LINE).encode() + b"\n" + bad)
        before = path.read_bytes()
        refused_by_call(RunFolder(root=tmp_path).read_journal, str(path), *words)
        assert path.read_bytes() == before

    check_each(JOURNALS, check)
    path.unlink()
    path.mkdir()
    refused_by_call(RunFolder(root=tmp_path).read_journal, path.name, "not a regular file")


def test_a_bad_line_of_traces_is_named(tmp_path):
    path = tmp_path / "traces.jsonl"

    def check(line):
        written(path, f'{{"id": "e0", "trace": []}}\n{line}\n')
        refused_by_call(lambda: RunFolder(root=tmp_path).cut_traces(["e0"]), str(path), "line 2")

    lines = ("x", "[]", "{}", '{"id": 5}', "[" * 200_000, '{"id": "e1", "id": "e2"}', "\0")
    check_each({line[:30]: line for line in lines}, check)


@pytest.mark.usefixtures("stubbed")
def test_a_bad_configuration_stops_a_resume_and_changes_nothing(tmp_path):
    arguments = (*stub_runs.RUN, "--out", tmp_path, "--resume")
    for edit in ({"versions": None}, {"more": 1}):
        path = written(tmp_path / "config.json", {**CONFIG, **edit})
        before = path.read_bytes()
        refused_by_command(main, arguments, str(path), next(iter(edit)))
        assert path.read_bytes() == before
        assert [entry.name for entry in tmp_path.iterdir()] == ["config.json"]


def test_large_numbers_that_are_allowed_do_not_overflow_the_statistics():
    episodes = tuple(
        EpisodeResult(**{**vars(one), "episode_return": 1e100}) for one in make_record().episodes
    )
    found = summarize(episodes, {"e0": {"plan": 1e100}})
    assert isinstance(found.mean_return, Estimate)
    assert math.isfinite(found.mean_return.mean)
    assert all(map(math.isfinite, found.mean_return.ci95))
