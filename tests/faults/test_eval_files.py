"""Invalid result files, journals and configurations: the error names file, episode and field."""

import json
import math
import os

import pytest
import stub_runs  # first: it finds the stub
from hab_eval.cli import main
from hab_eval.records.results import FinishedEpisode, read_record
from hab_eval.run.run_folder import RunFolder
from refusals import check_each, refused_by_call, refused_by_command
from stub_runs import make_record

from hab_tasks.typed_values import to_json

NAN, INF, HUGE = math.nan, math.inf, 10**400
SURROGATE = "half \ud800 of a pair"

WRONG = {
    "str": (None, SURROGATE),
    "name": (5, None, "", " "),
    "bool": (1, None),
    "count": (-1, 1.0, "1", None, True, HUGE, NAN, 2**63),
    "seconds": (-0.5, "1", None, True, HUGE, INF),
    "number": ("1", None, False, -1e308, NAN),
    "flags": (None, [], {"a": 1}, {SURROGATE: True}),
    "texts": (None, [], {"a": 1}, {"a": SURROGATE}),
    "failure": (5, "", "  "),
    "numbers": (None, {"sct": None}, {"sct": NAN}, {"sct": HUGE}),
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
OF_RECORD = dict.fromkeys(("agent", "agent_name", "env", "scene_dataset"), "name")
OF_RECORD |= dict.fromkeys(("control_mode", "obs_mode", "target_frame", "split", "device"), "str")
OF_RECORD |= {"privileged": "bool", "seed": "count", "options": "texts", "versions": "texts"}
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


def record_refused(tmp_path, data, *words):
    """Asserts that a record is refused."""
    path = written(tmp_path / "run.json", data)
    refused_by_call(lambda: read_record(path), str(path), *words)


def test_a_wrong_field_is_named(tmp_path):
    def of_record(case):
        field, value = case
        record_refused(tmp_path, GOOD | {field: value}, f"run.json: {field}")

    def of_episode(case):
        field, value = case
        first, second = GOOD["episodes"]
        data = GOOD | {"episodes": [first, second | {field: value}]}
        name = "e1" if field != "id" else "episodes[1]"
        record_refused(tmp_path, data, "episodes[1]", f": {field}", name)

    check_each(wrong_values(OF_RECORD), of_record)
    check_each(wrong_values(OF_EPISODE), of_episode)


OTHER_TASK = GOOD["episodes"][1] | {"stages": {"place_1": False}}
SUMMARY = GOOD["summary"]
WON = GOOD["episodes"][1] | {"success": True}
NO_RECORDS = {
    "schema 2": (GOOD | {"schema": 2}, "schema 2, this version reads 1"),
    "no seed": ({k: v for k, v in GOOD.items() if k != "seed"}, "missing keys ['seed']"),
    "won and failed": (GOOD | {"episodes": [WON], "timings_s": {}}, "success True and failure"),
    "mean": (
        GOOD | {"summary": SUMMARY | {"success": SUMMARY["success"] | {"mean": 0.9}}},
        "success.mean does not follow",
    ),
    "interval": (
        GOOD | {"summary": SUMMARY | {"success": SUMMARY["success"] | {"ci95": [0.5]}}},
        "a list of 2",
    ),
    "no episodes": (GOOD | {"episodes": []}, "episodes is empty"),
    "twice": (GOOD | {"episodes": [GOOD["episodes"][0]] * 2}, "'e0' appears 2 times"),
    "stages": (GOOD | {"episodes": [GOOD["episodes"][0], OTHER_TASK]}, "'e1'", "place_1", "'e0'"),
    "durations": (GOOD | {"timings_s": {"e1": {"plan": NAN}}}, "timings_s.e1"),
    "foreign timing": (GOOD | {"timings_s": {"e9": {}}}, "timings_s: unknown episode"),
    "extra keys": (GOOD | {f"key{i}": 1 for i in range(5000)}, "unknown keys", "4995 more"),
    "long value": (GOOD | {"seed": "x" * 100_000}, "seed"),
    "torn": (json.dumps(GOOD)[:-20], "JSON"),
    "deep": ('{"schema": 1, "agent": ' + "[" * 200_000 + "]" * 200_000 + "}", "deeply"),
    "key twice": ('{"schema": 1, "schema": 1}', 'duplicate key "schema"'),
}


def test_a_record_that_is_none_is_refused_with_its_reason(tmp_path):
    def check(name):
        refused_by_call(lambda: read_record(tmp_path / name), "cannot be read as JSON")

    check_each(NO_RECORDS, lambda case: record_refused(tmp_path, *case))
    (tmp_path / "utf-16").write_bytes(json.dumps(GOOD).encode("utf-16"))
    os.mkfifo(tmp_path / "pipe")  # reading it would wait for ever
    names = ("utf-16", "pipe", "absent", ".", "x" * 300, "a\0b")
    check_each({name: name for name in names}, check)


def test_too_many_episodes_are_counted_before_a_file_is_parsed(tmp_path):
    many = '"failure": null, "failure":"x", "failure": 1, ' * 50_001  # a timing has a number
    path, found = tmp_path / "rows" / "run.json", "100002 episodes; at most 100000 are valid"
    path.parent.mkdir()
    written(path, many + " " * 10_000_000)
    rows = ("--submissions", path.parent)
    commands = [(name, path) for name in ("submit", "verify")]
    commands += [(name, path, "--out", tmp_path / "new.png") for name in ("failures", "film")]
    commands += [("table", *rows, "--check"), ("site", *rows, "--out", tmp_path / "site")]
    check_each(
        {command[0]: command for command in commands},
        lambda command: refused_by_command(main, command, str(path), found),
    )
    path.rename(path.with_name("episodes.jsonl"))
    refused_by_call(RunFolder(root=path.parent).read_journal, "episodes.jsonl", found)
    record_refused(tmp_path, GOOD | {"episodes": [{}] * 100_001}, "100001 episodes")


CONTRADICTION = LINE | {"episode": LINE["episode"] | {"id": "e2", "success": True}}
JOURNALS = {
    "text": ("x", "line 2", "JSON"),
    "twice": (json.dumps(LINE), "line 2", "'e1' appears twice"),
    "key twice": ('{"episode": 1, "episode": 2}', "line 2", "duplicate key"),
    "extra": (json.dumps({**LINE, "more": 1}), "line 2", "unknown keys"),
    "duration": (json.dumps(LINE | {"timings_s": {"plan": -1}}), "line 2", "timings_s"),
    "contradiction": (json.dumps(CONTRADICTION), "line 2", "'e2'", "success True"),
    "no text": ("\xff", "line 2", "UTF-8"),
}


def test_a_bad_line_of_a_journal_is_named(tmp_path):
    path = tmp_path / "episodes.jsonl"

    def check(case):
        bad, *words = case
        path.write_bytes(f"{json.dumps(LINE)}\n{bad}\n".encode("latin-1"))
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

    lines = ("x", "[]", "{}", '{"id": 5}', "[" * 200_000, '{"id": "e1", "id": "e2"}')
    check_each({line[:30]: line for line in lines}, check)


@pytest.mark.usefixtures("stubbed")
def test_a_bad_configuration_stops_a_resume_and_changes_nothing(tmp_path):
    arguments = (*stub_runs.RUN, "--out", tmp_path, "--resume")
    config = CONFIG["config"] | {"episodes": -1}
    for edit in ({"versions": None}, {"more": 1}, {"config": config}):
        path = written(tmp_path / "config.json", CONFIG | edit)
        before = path.read_bytes()
        refused_by_command(main, arguments, str(path), next(iter(edit)))
        assert path.read_bytes() == before
        assert [entry.name for entry in tmp_path.iterdir()] == ["config.json"]
