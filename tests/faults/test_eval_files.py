"""Invalid result files, journals and configurations: the error names file, episode and field."""

import copy
import json
import math

import pytest
import stub_runs  # first: it finds the stub

import stub_hab  # isort: skip
from hab_eval.cli import main
from hab_eval.config import read_config
from hab_eval.results import EpisodeResult, FinishedEpisode, read_record, summarize
from hab_eval.run_folder import RunFolder
from hab_eval.schema import parse_json_text, to_json
from hab_eval.stats import Estimate
from refusals import refused_by_call, refused_by_command
from stub_runs import make_record

NAN, INF, HUGE = math.nan, math.inf, 10**400
SURROGATE = "half \ud800 of a pair"

WRONG = {
    "str": (5, None, True, 0.5, ["x"], {}, SURROGATE),
    "name": (5, None, False, [], {}, "", " ", SURROGATE),
    "bool": (0, 1, None, "true", [], NAN),
    "count": (-1, 1.0, "1", None, True, [], HUGE, NAN, INF, 2**63),
    "seconds": (-0.5, "1", None, True, [], HUGE, 1e308, NAN, INF, -INF),
    "number": ("1", None, False, {}, HUGE, -HUGE, 1e308, -1e308, NAN, INF),
    "flags": (None, [], 1, {"a": 1}, {"a": None}, {SURROGATE: True}),
    "texts": (None, [], "x", {"a": 1}, {"a": None}, {"a": SURROGATE}),
    "failure": (5, True, [], {}, "", "  ", SURROGATE),
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


def cases_of(fields):
    return [
        pytest.param(field, value, id=f"{field}-{number}")
        for field, kind in fields.items()
        for number, value in enumerate(WRONG[kind])
    ]


def written(path, value):
    path.write_text(value if isinstance(value, str) else json.dumps(value))
    return path


def test_the_good_files_are_good(tmp_path):
    assert read_record(written(tmp_path / "run.json", GOOD)) == make_record()
    assert read_config(written(tmp_path / "config.json", CONFIG)).config.episodes == 2
    written(tmp_path / "episodes.jsonl", json.dumps(LINE) + "\n")
    assert list(RunFolder(root=tmp_path).read_journal()) == ["e1"]


@pytest.mark.parametrize(("field", "value"), cases_of(OF_EPISODE))
def test_a_wrong_field_of_an_episode_is_named_in_a_record(tmp_path, field, value):
    data = copy.deepcopy(GOOD)
    data["episodes"][1][field] = value
    path = written(tmp_path / "run.json", data)
    told = "e1" if field != "id" else "episodes[1]"
    refused_by_call(lambda: read_record(path), str(path), "episodes[1]", f": {field}", told)


@pytest.mark.parametrize(("field", "value"), cases_of({**OF_EPISODE, "timings_s": "durations"}))
def test_a_wrong_field_of_an_episode_is_named_in_a_journal(tmp_path, field, value):
    line = copy.deepcopy(LINE)
    (line if field == "timings_s" else line["episode"])[field] = value
    path = written(tmp_path / "episodes.jsonl", "\n".join(map(json.dumps, [line])) + "\n")
    told = "e1" if field != "id" else "line 1"
    refused_by_call(RunFolder(root=tmp_path).read_journal, str(path), "line 1", field, told)


@pytest.mark.parametrize(("field", "value"), cases_of(OF_RECORD))
def test_a_wrong_field_of_a_record_is_named(tmp_path, field, value):
    path = written(tmp_path / "run.json", {**GOOD, field: value})
    refused_by_call(lambda: read_record(path), str(path), f"{path}: {field}")


@pytest.mark.parametrize("value", WRONG["durations"], ids=range(len(WRONG["durations"])))
def test_a_wrong_duration_is_named_with_its_episode(tmp_path, value):
    path = written(tmp_path / "run.json", {**GOOD, "timings_s": {"e1": value}})
    refused_by_call(lambda: read_record(path), str(path), "timings_s.e1")


@pytest.mark.parametrize(("field", "value"), cases_of(OF_CONFIG))
def test_a_wrong_field_of_a_configuration_is_named(tmp_path, field, value):
    config = {**CONFIG, "config": {**CONFIG["config"], field: value}}
    path = written(tmp_path / "config.json", config)
    refused_by_call(lambda: read_config(path), str(path), field)


def edit_of(**changes):
    return {**GOOD, **changes}


CONTRADICTIONS = {
    "schema_true": (edit_of(schema=True), "schema"),
    "schema_text": (edit_of(schema="1"), "schema"),
    "schema_huge": (edit_of(schema=HUGE), "schema"),
    "no_episodes": (edit_of(episodes=[]), "episodes is empty"),
    "episodes_dict": (edit_of(episodes={}), "episodes"),
    "episode_list": (edit_of(episodes=[[]]), "episodes[0]"),
    "twice": (edit_of(episodes=[GOOD["episodes"][0]] * 2), "'e0' appears 2 times"),
    "foreign_timing": (edit_of(timings_s={"e9": {}}), "timings_s: unknown episode"),
    "foreign_timings": (edit_of(timings_s={"e9": {"plan": 1.0}}), "unknown episode"),
    "summary_none": (edit_of(summary=None), "summary"),
    "extra_keys": (edit_of(**{f"key{i}": 1 for i in range(5000)}), "unknown keys", "4995 more"),
    "long_key": (edit_of(**{"k" * 100_000: 1}), "unknown keys"),
    "long_value": (edit_of(seed="x" * 100_000), "seed"),
    "big_list": (edit_of(seed=[0] * 100_000), "seed"),
    "list": ([GOOD], "schema"),
    "text": ('"run"', "schema"),
    "null": ("null", "schema"),
    "number": ("1", "schema"),
    "empty": ("", "JSON"),
    "blank": (" \n", "JSON"),
    "torn": (json.dumps(GOOD)[:-20], "JSON"),
    "two": (json.dumps(GOOD) * 2, "JSON"),
    "nan_outside": ("NaN", "schema"),
    "deep_lists": ("[" * 200_000 + "]" * 200_000, "nested too deeply"),
    "deep_objects": ('{"a":' * 200_000 + "1" + "}" * 200_000, "nested too deeply"),
    "deep_field": ('{"schema": 1, "agent": ' + "[" * 200_000 + "]" * 200_000 + "}", "deeply"),
    "digits": ('{"schema": ' + "1" * 5000 + "}", "JSON"),
    "twice_key": ('{"schema": 1, "schema": 1}', 'duplicate key "schema"'),
    "trailing": (json.dumps(GOOD) + ",", "JSON"),
    "comment": ("// a run\n" + json.dumps(GOOD), "JSON"),
    "single_quotes": ("{'schema': 1}", "JSON"),
}


@pytest.mark.parametrize("case", CONTRADICTIONS)
def test_a_record_that_is_none_is_refused_with_its_reason(tmp_path, case):
    value, *words = CONTRADICTIONS[case]
    path = written(tmp_path / "run.json", value)
    refused_by_call(lambda: read_record(path), str(path), *words)


def test_episodes_of_two_tasks_are_refused(tmp_path):
    data = copy.deepcopy(GOOD)
    data["episodes"][1]["stages"] = {"place_1": False}
    path = written(tmp_path / "run.json", data)
    refused_by_call(lambda: read_record(path), str(path), "'e1'", "place_1", "'e0'")


BYTES = {
    "latin": b'{"schema": 1, "agent": "\xe9"}',
    "utf16": json.dumps(GOOD).encode("utf-16"),
    "binary": bytes(range(256)),
    "nul": b"\0" * 100,
    "bom": b"\xef\xbb\xbf" + json.dumps(GOOD).encode(),
}


@pytest.mark.parametrize("case", BYTES)
def test_bytes_that_are_no_text_are_refused(tmp_path, case):
    path = tmp_path / "run.json"
    path.write_bytes(BYTES[case])
    refused_by_call(lambda: read_record(path), str(path), "cannot be read as JSON")


@pytest.mark.parametrize("case", ["absent", "folder", "fifo", "below_a_file", "long", "nul"])
def test_a_path_that_is_no_file_is_refused_at_once(tmp_path, case):
    import os

    path = tmp_path / "run.json"
    if case == "folder":
        path.mkdir()
    elif case == "fifo":
        os.mkfifo(path)  # reading it would wait for ever
    elif case == "below_a_file":
        path.write_text("")
        path = path / "run.json"
    elif case == "long":
        path = tmp_path / ("x" * 300)
    elif case == "nul":
        path = tmp_path / "a\0b"
    refused_by_call(lambda: read_record(path), "cannot be read as JSON")


def test_a_pipe_in_the_place_of_a_run_is_one_line(tmp_path):
    import os

    os.mkfifo(tmp_path / "pipe")
    arguments = ("failures", tmp_path / "pipe", "--out", tmp_path / "x.png")
    refused_by_command(main, arguments, "pipe", "not a regular file")


JOURNALS = {
    "blank_line": ("\n", "line 2", "JSON"),
    "text": ("x\n", "line 2", "JSON"),
    "list": ("[]\n", "line 2", "an object"),
    "nul": ("\0\0\0\n", "line 2", "JSON"),
    "deep": ("[" * 200_000 + "\n", "line 2", "nested too deeply"),
    "twice": (json.dumps(LINE) + "\n", "line 2", "'e1' appears twice"),
    "twice_key": ('{"episode": 1, "episode": 2}\n', "line 2", "duplicate key"),
    "extra": (json.dumps({**LINE, "more": 1}) + "\n", "line 2", "unknown keys"),
    "contradiction": (
        json.dumps({**LINE, "episode": {**LINE["episode"], "id": "e2", "success": True}}) + "\n",
        "line 2",
        "'e2'",
        "success True",
    ),
}


@pytest.mark.parametrize("case", JOURNALS)
def test_a_bad_line_of_a_journal_is_named(tmp_path, case):
    bad, *words = JOURNALS[case]
    path = written(tmp_path / "episodes.jsonl", json.dumps(LINE) + "\n" + bad)
    before = path.read_bytes()
    refused_by_call(RunFolder(root=tmp_path).read_journal, str(path), *words)
    assert path.read_bytes() == before


def test_a_line_of_a_journal_that_is_no_text_is_named(tmp_path):
    path = tmp_path / "episodes.jsonl"
    path.write_bytes(json.dumps(LINE).encode() + b"\n\xff\xfe\n")
    refused_by_call(RunFolder(root=tmp_path).read_journal, str(path), "line 2", "UTF-8")


TRACES = ("x", "[]", "{}", '{"id": 5}', "[" * 200_000, '{"id": "e1", "id": "e2"}', "\0")


@pytest.mark.parametrize("line", TRACES, ids=range(len(TRACES)))
def test_a_bad_line_of_traces_is_named(tmp_path, line):
    path = written(tmp_path / "traces.jsonl", f'{{"id": "e0", "trace": []}}\n{line}\n')
    refused_by_call(lambda: RunFolder(root=tmp_path).cut_traces(["e0"]), str(path), "line 2")


@pytest.mark.parametrize("name", ["episodes.jsonl", "traces.jsonl"])
def test_a_folder_in_the_place_of_a_journal_is_named(tmp_path, name):
    (tmp_path / name).mkdir()
    folder = RunFolder(root=tmp_path)
    read = folder.read_journal if name == "episodes.jsonl" else lambda: folder.cut_traces([])
    refused_by_call(read, name, "not a regular file")


@pytest.mark.parametrize("edit", [{"versions": None}, {"git": 5}, {"config": []}, {"more": 1}])
def test_a_bad_configuration_stops_a_resume_and_changes_nothing(tmp_path, edit):
    path = written(tmp_path / "config.json", {**CONFIG, **edit})
    before = path.read_bytes()
    undo = stub_hab.install()
    arguments = (*stub_runs.RUN, "--out", tmp_path, "--resume")
    refused_by_command(main, arguments, str(path), next(iter(edit)))
    undo()
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


def test_what_is_written_is_what_is_read(tmp_path):
    text = json.dumps(GOOD)
    assert to_json(read_record(written(tmp_path / "run.json", text))) == parse_json_text(text)
