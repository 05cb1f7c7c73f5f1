import re
from dataclasses import replace
from pathlib import Path

from hab_eval.records.leaderboard import build_groups, to_html, to_markdown
from hab_eval.records.results import summarize, write_record
from stub_runs import make_record

ROOT = Path(__file__).resolve().parents[2]
PAGES = ("README.md", "docs/status.md", "docs/speed.md")
MARK = re.compile(r"^<!-- (status|bench): ", flags=re.MULTILINE)


def test_committed_pages_follow_from_the_submissions(cli):
    """Every page with generated tables; `hab-eval table` names what differs."""
    marked = {
        str(p.relative_to(ROOT))
        for p in (*ROOT.glob("*.md"), *ROOT.glob("*/*.md"), *ROOT.glob("*/*/*.md"))
        if MARK.search(p.read_text("utf-8"))
    }
    assert marked == set(PAGES)
    pages = [word for page in PAGES for word in ("--pages", ROOT / page)]
    done = cli("table", *pages, "--check")
    assert done.returncode == 0, done.stderr


def test_rows_are_grouped_and_sorted_whatever_the_order_of_files():
    records = {
        "worse.json": make_record((False, False), name="Worse"),
        "better.json": make_record((True, True), name="Better", privileged=True),
        "tie_b.json": make_record((True, False), name="B", seed=1),
        "tie_a.json": make_record((True, False), name="A", seed=2),
        "other.json": make_record(env="HabPlace-v1"),
        "ycb.json": make_record(objects="ycb"),
        "set.json": replace(make_record(), control_mode="joint_state_pose"),
        "language.json": make_record(targets="language", instruction="task"),
        "rules.json": replace(make_record(), skill_config={"rest_radius_m": 100.0}),
    }
    groups = build_groups(records)
    assert build_groups(dict(reversed(records.items()))) == groups
    assert [group.title for group in groups] == [
        "HabPick-v1, apartment",
        "HabPick-v1, apartment, changed rules: rest_radius_m=100",
        "HabPick-v1, apartment, language",
        "HabPick-v1, apartment, objects ycb",
        "HabPick-v1, apartment, perfect arm control, perfect base control",
        "HabPlace-v1, apartment",
    ]
    assert [row[0] for row in groups[0].rows] == ["Better †", "A", "B", "Worse"]


def test_a_row_by_hand():
    (group,) = build_groups({"x.json": make_record((True, True, True, True, False))})
    # 4 of 5: 80 %, Wilson 37.6 to 96.4; lengths 10..50, mean 30; 2.5 s in 150 steps.
    wanted = "Stub; 80.0 [37.6, 96.4]; 80; 5*; 30.0; ee; 0.0167; no; val; 0; 0.1.0 (01234567)"
    assert "; ".join(group.rows[0]) == wanted
    (mixed,) = build_groups({"x.json": make_record(git="0123456789 then abcdef0123-dirty")})
    assert mixed.rows[0][-1] == "0.1.0 (01234567 then abcdef01-dirty)"
    # Split and seed are in the command below; the agent has the name that `--agent` takes.
    assert r"|constant|80.0 [37.6, 96.4]|80|5\*|30.0|ee|0.1.0 (01234567)|" in to_markdown([group])
    assert "<td>80.0 [37.6, 96.4]</td>" in to_html([group])


def test_a_task_says_how_often_each_stage_was_reached_and_what_it_scores():
    record = make_record((True, False))
    # Out of alphabetical order: the order is that of the task.
    told = ({"pick_1": True, "a": True}, {"pick_1": True, "a": False})
    # 0.9 of a success and nothing of a failure: 45 %.
    episodes = tuple(
        replace(one, stages=stages, scores={"sct": 0.9 * one.success})
        for one, stages in zip(record.episodes, told, strict=True)
    )
    task = replace(record, episodes=episodes, summary=summarize(episodes, {}))
    (group,) = build_groups({"x.json": task})
    assert group.columns[:5] == ("agent", "success %", "stages %", "SCT %", "n")
    assert group.rows[0][2:4] == ("100 50", "45.0")
    assert group.note == "Stages: pick_1, a."
    assert "Stages: pick_1, a." in to_markdown([group])
    (both,) = build_groups({"a.json": record, "b.json": task})
    assert sorted(row[3] for row in both.rows) == ["", "45.0"]  # an older run has no score
    episodes = tuple(replace(episode, stages={}) for episode in record.episodes)
    skill = replace(record, episodes=episodes, summary=summarize(episodes, {}))
    (group,) = build_groups({"x.json": skill})
    assert len(group.rows[0]) == len(group.columns) == 10


def test_what_an_agent_is_told_and_its_options_stand_beside_its_name():
    def label(**changes):
        (group,) = build_groups({"x.json": make_record(**changes)})
        return group.rows[0][0]

    options = {"navigation": "teleport", "policy": "/home/me/policy.pt"}
    told = "Stub † (navigation=teleport, policy=policy.pt)"
    assert label(privileged=True, options=options) == told
    assert label(handle_position=True) == "Stub (handle_position)"
    cameras = {"cameras": ("head",), "camera_size_px": 224, "camera_hfov_rad": 1.2}
    told = "Stub (instruction=task, cameras=head, camera_size_px=224, camera_hfov_rad=1.2)"
    assert label(instruction="task", **cameras) == told
    assert label(target_frame="ee", options={"a": "b"}) == "Stub (target_frame=ee, a=b)"


def test_table_command_writes_and_checks(cli, tmp_path):
    submissions = tmp_path / "submissions"
    submissions.mkdir()
    write_record(submissions / "a.json", make_record())
    target = tmp_path / "BOARD.md"
    arguments = ("table", "--submissions", submissions, "--out", target)
    assert cli(*arguments, "--check").returncode == 1
    assert cli(*arguments).returncode == 0
    first = target.read_bytes()
    assert cli(*arguments, "--check").returncode == 0
    assert cli(*arguments).returncode == 0
    assert target.read_bytes() == first
    write_record(submissions / "b.json", make_record(name="New"))
    assert "out of date" in cli(*arguments, "--check").stderr
