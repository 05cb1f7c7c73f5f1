"""Tables of the status page, and rows that are to be run again."""

import hashlib
import json
import subprocess
from dataclasses import replace

import pytest
import stub_runs
from hab_eval.errors import ResultError
from hab_eval.records.leaderboard import (
    Submissions,
    default_submissions,
    find_submissions,
    with_submission,
)
from hab_eval.records.provenance import COMMIT_SEPARATOR
from hab_eval.records.results import write_record
from hab_eval.records.status import again_table, best_table, rows_table
from hab_eval.site.build import SiteOptions, build_site
from stub_runs import make_record

from hab_tasks.registration import SKILLS, TASKS

CURRENT = {
    **dict.fromkeys(SKILLS, "0.2.0"),
    **dict.fromkeys(("HabPlace-v1", "HabCloseFridge-v1", "HabNavigate-v1", *TASKS), "0.3.0"),
}
"""Environment -> first version in which driven policies play and are judged as today."""


def submitted(again=(), **records):
    return Submissions(all=records, again=dict.fromkeys(again, "2026-11-23"))


def agent(name, wins, episodes, **changes):
    outcomes = (True,) * wins + (False,) * (episodes - wins)
    return replace(make_record(outcomes, **changes), agent=name)


def last_row(found):
    return best_table(found, "B.md").splitlines()[-1]


def test_the_best_of_each_kind_is_chosen_among_current_rows():
    found = submitted(
        again=("old",),
        old=agent("hab_ppo:pick_old", 10, 10),
        planner=agent("hab_spa:spa_priv", 9, 10, privileged=True),
        policy=agent("hab_ppo:pick_blind", 7, 10, handle_position=True),
        worse=agent("hab_ppo:pick_worse", 6, 10),
        there=agent("hab_ppo:pick_depth", 10, 10, scene_dataset="replicaCAD"),
        sensed=agent("hab_spa:spa", 8, 10),
        random=agent("hab_eval:random_agent", 10, 10),
    )
    where = "B.md#habpick-v1-apartment"
    assert last_row(found) == (
        f"| HabPick-v1 | [spa]({where}): 80.0 % (n = 10) "
        f"| [pick_blind ‡]({where}): 70.0 % (n = 10) "
        f"| [spa_priv †]({where}): 90.0 % (n = 10) | 86.3 % (MonolithicRL, depth; Table 3) |"
    )
    # Where nothing is current, the table says so.
    old = agent("hab_ppo:navigator", 1, 2, env="HabNavigate-v1")
    row = last_row(submitted(again=("old",), old=old))
    assert row == f"| HabNavigate-v1 {3 * '| to be run again '}| not printed |"


def test_a_row_that_is_run_again_is_in_that_list_alone(tmp_path):
    old, new = agent("a:old", 1, 2), agent("a:new", 4, 5, objects="ycb")
    found = submitted(again=("old",), old=old, new=new)
    assert again_table(found, "").splitlines()[2:] == [
        "| old | 1 | Pick | apartment | 2026-11-23 |"
    ]
    # 4 of 5: Wilson 37.6 to 96.4.
    (row,) = rows_table(found, "B.md").splitlines()[2:]
    assert row == (
        "| HabPick-v1 | [new](B.md#habpick-v1-apartment-objects-ycb) | 80.0 [37.6, 96.4] | 5 "
        "| apartment, ycb | val | 0.1.0 |"
    )
    folder = tmp_path / "submissions"
    folder.mkdir()
    write_record(folder / "a.json", old)
    write_record(folder / "b.json", new)
    (tmp_path / "to_run_again.json").write_text(json.dumps({"a.json": "2026-11-23"}))
    build_site(SiteOptions(out=tmp_path / "site", submissions=folder, checkout=tmp_path))
    page = (tmp_path / "site" / "leaderboard.html").read_text("utf-8")
    ranked, listed = page.split('<h2 id="again">')
    assert "1 of 1 runs" in ranked
    assert "<td>old</td><td>1</td><td>Pick</td><td>apartment</td><td>2026-11-23</td>" in listed


def test_a_new_submission_of_a_name_ends_its_wait(tmp_path):
    folder = tmp_path / "submissions"
    folder.mkdir()
    write_record(folder / "a.json", make_record())
    again = tmp_path / "to_run_again.json"
    again.write_text(json.dumps({"a.json": "2026-11-23"}))
    assert find_submissions(folder).current == {}
    assert list(with_submission(folder, "a.json", make_record()).current) == ["a.json"]
    write_record(folder / "b.json", make_record(env="HabPlace-v1"))
    assert list(find_submissions(folder, "HabPlace-v1").current) == ["b.json"]
    (folder / "b.json").unlink()
    again.write_text(json.dumps({"b.json": "2026-11-23"}))
    with pytest.raises(ResultError, match=r"b\.json"):
        find_submissions(folder)


def git(*arguments, given=""):
    """Runs git on the checkout; its output as bytes."""
    command = ["git", "-C", stub_runs.ROOT, *arguments]
    if not (stub_runs.ROOT / ".git").exists():
        pytest.skip("not a git checkout")
    return subprocess.run(command, input=given.encode(), capture_output=True, check=True).stdout


def test_rows_of_older_versions_and_lost_commits_are_to_be_run_again():
    current = find_submissions(default_submissions()).current
    assert not [n for n, r in current.items() if r.versions["hab-tasks"] < CURRENT[r.env]]
    commits = {
        one.partition("-")[0]
        for record in current.values()
        for one in (record.git or "").split(COMMIT_SEPARATOR)
    }
    names = "\n".join(f"{commit}^{{commit}}" for commit in sorted(commits))
    assert b"missing" not in git("cat-file", "--batch-check", given=names)


def test_the_weights_of_every_row_are_in_its_commit():
    records = find_submissions(default_submissions()).current.values()
    weights = {
        (record.git, name, digest)
        for record in records
        if record.agent_files is not None
        for name, digest in record.agent_files.data.items()
    }
    for commit, name, digest in sorted(weights):
        content = git("show", f"{commit}:baselines/ppo/{name}")
        assert hashlib.sha256(content).hexdigest() == digest, name
