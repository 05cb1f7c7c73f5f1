"""The results site: order and names, commands, breakdowns, comparisons, cards and files."""

import gzip
import json
import re

import pytest
from hab_eval.errors import ResultError
from hab_eval.records import paper
from hab_eval.records.results import highlights, video_name, write_record
from hab_eval.site import comparison
from hab_eval.site.agents import agent_pages, read_cards
from hab_eval.site.breakdown import by_layout, by_receptacle, histogram, read_receptacles
from hab_eval.site.comparison import comparison_sets
from hab_eval.site.entries import counterparts, kinds_of, make_entries
from hab_eval.site.media import rendered
from PIL import Image
from site_records import record_of, write_submissions

from hab_tasks.errors import FileError


def test_entries_are_in_the_order_of_the_registry_then_by_success():
    records = {
        "c.json": record_of([None], env="HabTidyHouse-v1"),
        "b.json": record_of(["x"], env="HabPick-v1"),
        "a.json": record_of([None], env="HabPick-v1", scene_dataset="apartment_wild_0"),
        "d.json": record_of([None], env="HabPick-v1"),
        "e.json": record_of([None], env="Another-v1"),
    }
    assert [entry.name for entry in make_entries(records)] == ["d", "b", "a", "c", "e"]
    learned = {"agent": "hab_spa:tp_spa_priv", "options": {"navigation": "hab_ppo:navigate"}}
    assert kinds_of(record_of([None], **learned)) == ("learned", "planned")
    assert kinds_of(record_of([None], agent="mine:agent")) == ("other",)


def test_breakdowns_by_hand():
    # Layouts alternate: layout_0 has episodes 0, 2, 4 (all solved), layout_1 has 1 and 3 (one).
    record = record_of([None, "force", None, None, None])
    found = [(one.name, one.successes, one.success.n) for one in by_layout(record)]
    assert found == [("layout_1", 1, 2), ("layout_0", 3, 3)]
    assert highlights(record) == (0, 1)
    bins = histogram(record, [0.0, 1.0, 2.0, 3.0, 4.0])
    assert bins["success"][0] == bins["success"][-1] == 1
    assert sum(bins["success"]) == 4
    assert bins["failure"][5] == 1  # 1.0 is the left edge of bin 5 of 20 on [0, 4]


def test_receptacles_come_from_episode_files(tmp_path):
    record = record_of([None, "x"])
    first, second = record.episodes

    def episode(one, **changes):
        target = {"start": ["receptacle_aabb_sink", "link"], "goal": None}
        plain = {"handle": None, "navigation": None, "targets": [target]}
        return {"id": one.id, "scene_id": one.scene, **plain, **changes}

    def written(*episodes):
        with gzip.open(tmp_path / "a.json.gz", "wt") as file:
            json.dump({"episodes": episodes}, file)
        return read_receptacles(tmp_path)

    handle = {"furniture": "f", "joint": "top_hinge", "marker": "m"}
    shares = by_receptacle(record, written(episode(first), episode(second, handle=handle)))
    assert [(one.name, one.success.mean) for one in shares] == [("top_hinge", 0.0), ("sink", 1.0)]
    for other in ((), (episode(second, scene_id="another"),), (episode(second, targets=[]),)):
        assert by_receptacle(record, written(episode(first), *other)) == []
    (tmp_path / "a.json.gz").write_bytes(b"no gzip")
    with pytest.raises(ResultError, match=r"a\.json\.gz: cannot be read as an episode file"):
        read_receptacles(tmp_path)


def test_only_runs_on_the_same_episodes_are_compared(monkeypatch):
    records = {
        "a.json": record_of([None, None]),
        "b.json": record_of([None, "x", "x"]),
        "other_seed.json": record_of([None, None], seed=1),
        "other_objects.json": record_of([None, None], objects="ycb"),
    }
    (one,) = comparison_sets(make_entries(records))
    assert [entry.name for entry in one.entries] == ["a", "b"]
    data = one.data()
    # Of two common episodes both solve one, and only a the other: p = 1.
    assert data["pairs"] == [[0, 1, 2, 1, 1, 0, 1.0]]
    assert data["runs"][0]["outcome"] == [0, 0, None]
    assert data["runs"][1]["outcome"] == [0, 1, 1]
    assert data["runs"][1]["outcomes"] == ["success", "x"]
    monkeypatch.setattr(comparison, "MOST_COMPARED", 2)
    many = {f"{name}.json": record_of([None] * 2) for name in "cde"}
    (one,) = comparison_sets(make_entries({**many, **records}))
    assert len(one.entries) == 2
    assert len(one.pairs) == 1


def test_the_papers_results_have_counterparts_on_the_same_protocol():
    spa = {"agent": "hab_spa:spa", "env": "HabPick-v1"}
    real = {"scene_dataset": "replicaCAD", "objects": "ycb"}
    records = {
        "unseen.json": record_of([None], **spa),
        "seen.json": record_of([None], split="train", **real, **spa),
        "option.json": record_of([None], options={"controller": "perfect"}, **spa),
        "train.json": record_of([None], split="train", **spa),
        "place.json": record_of([None], **{**spa, "env": "HabPlace-v1"}),
        "priv.json": record_of([None], **{**spa, "agent": "hab_spa:spa_priv"}),
    }
    entries = make_entries(records)
    found = [[one.name for one in counterparts(r, entries)] for r in paper.RESULTS]
    assert found == [["priv"], ["unseen"], ["seen"], [], []]


CARD = """# place_blind

<script>alert(1)</script> [code](../x.py) [site](https://example.org) [bad](javascript:alert)

![Curve](place_blind.png) ![remote](https://example.org/x.png) ![up](../up.png)

| a | b |
| --- | --- |
| 1 | 2 |
"""


def test_a_model_card_loads_nothing_and_runs_nothing(tmp_path):
    folder = tmp_path / "baselines" / "ppo" / "hab_ppo" / "weights"
    folder.mkdir(parents=True)
    (folder / "place_blind.md").write_text(CARD)
    Image.new("RGB", (4, 4)).save(folder / "place_blind.png")
    Image.new("RGB", (4, 4)).save(folder.parent / "up.png")
    (card,) = read_cards(tmp_path)
    assert card.agent == "hab_ppo:place_blind"
    html, pictures = rendered(card.file, "folder")
    assert pictures == card.file.pictures == ["place_blind.png"]
    assert re.findall(r'src="([^"]*)"', html) == ["folder/place_blind.webp"]
    assert re.findall(r'href="([^"]*)"', html) == ["https://example.org"]
    assert "<script" not in html
    assert "<td>2</td>" in html
    entries = make_entries({"a.json": record_of([None], agent="hab_ppo:place_blind", name="P")})
    (page,) = agent_pages(entries, [card])
    assert (page.name, page.card, len(page.entries)) == ("P", card, 1)
    (folder / "place_blind.md").write_bytes(b"\xff")
    with pytest.raises(ResultError, match=r"place_blind\.md: cannot be read"):
        read_cards(tmp_path)


def files_of(folder):
    return {str(p.relative_to(folder)): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


def links_of(page):
    """Files that a page refers to."""
    found = re.findall(r'(?:href|src)="([^"#]+)', page.read_text())
    return [page.parent / link for link in found if not re.match("https?:|data:", link)]


def test_a_site_is_complete_reproducible_and_replaced_only_with_force(cli, tmp_path, monkeypatch):
    submissions = write_submissions(tmp_path / "submissions")
    study = tmp_path / "eval" / "studies" / "seeds"
    study.mkdir(parents=True)
    (study / "README.md").write_text("# Three seeds\n\nThey differ.\n\n![Curves](curves.png)\n")
    Image.new("RGB", (4, 4)).save(study / "curves.png")
    write_record(study / "seed0.json", record_of([None, "force"], env="HabPick-v1"))
    out = tmp_path / "site"
    arguments = ("site", "--submissions", submissions, "--checkout", tmp_path, "--out", out)
    done = cli(*arguments)
    assert (done.returncode, done.stderr) == (0, "")
    first = files_of(out)
    assert set(json.loads(first["site.json"])["pages"]) == {f for f in first if f.endswith(".html")}
    assert {f"runs/{path.stem}.html" for path in submissions.iterdir()} < set(first)
    links = [link for page in out.rglob("*.html") for link in links_of(page)]
    assert not [link for link in links if not link.exists()]
    studies = first["studies.html"].decode()
    assert '<h2 id="seeds">Three seeds</h2>' in studies
    assert '<th scope="row">seed0</th><td>HabPick-v1</td>' in studies
    assert "studies/seeds/curves.webp" in first
    assert "exists; give --force to replace it" in cli(*arguments).stderr
    assert cli(*arguments, "--force").returncode == 0
    assert files_of(out) == first

    def fail(*_):
        raise FileError(tmp_path, "is full")

    monkeypatch.setattr("hab_eval.site.build._write_static", fail)
    assert cli(*arguments, "--force").returncode == 2
    assert files_of(out) == first
    assert not list(tmp_path.glob(".*"))


def test_own_runs_make_a_site_with_their_videos_and_pages(cli, tmp_path):
    record, runs = record_of([None, "force"], env="HabPick-v1"), []
    for parent in "ab":
        runs.append(tmp_path / parent / "mine")
        write_record(runs[-1] / "run.json", record)
    name = video_name(1, record.episodes[1].id)
    (runs[0] / f"{name}.mp4").touch()
    (runs[0] / "view_1.html").write_bytes(b"x" * 1_250_000)
    command, out = ("--checkout", tmp_path, "--out", tmp_path / "site"), tmp_path / "site"
    assert cli("site", runs[0], *command).returncode == 0
    wanted = {"runs/mine.html", f"videos/mine/{name}.mp4", "views/mine/view_1.html"}
    assert wanted < set(files_of(out))
    assert "force · 1.2 MB" in (out / "runs" / "mine.html").read_text("utf-8")
    assert "<b>50 %</b>" in (out / "index.html").read_text("utf-8")
    assert "two runs are named 'mine'" in cli("site", *runs, *command, "--force").stderr
    (runs[0] / "view_2.html").touch()
    refused = cli("site", runs[0], *command, "--force").stderr
    assert "view_2.html: mine has the episodes view_0 to view_1." in refused


def test_bad_folders_are_refused_before_anything_is_written(cli, tmp_path):
    foreign, empty = tmp_path / "foreign", tmp_path / "empty"
    for folder in (foreign, empty):
        folder.mkdir()
    (foreign / "mine.txt").touch()
    full = write_submissions(tmp_path / "submissions")
    before = files_of(tmp_path)
    for changes, message in (
        ({"--submissions": empty}, "no submissions; hab-eval submit adds one"),
        ({"--submissions": tmp_path / "no"}, "not a folder of submissions"),
        ({"--out": foreign}, "contains files but no site.json"),
        ({"--checkout": tmp_path / "no"}, "not a folder; give a clone"),
    ):
        options = {"--submissions": full, "--out": tmp_path / "site", **changes}
        done = cli("site", *(word for pair in options.items() for word in pair), "--force")
        assert (done.returncode, done.stderr.count("\n")) == (2, 1)
        assert message in done.stderr
    assert files_of(tmp_path) == before
