"""`hab-eval view`: an episode as a recording for the browser."""

import shutil
import sys

import pytest
from hab_eval.cli import main
from hab_eval.records.results import read_record

msgspec = pytest.importorskip("msgspec", reason="the package viser is not installed")
zstandard = pytest.importorskip("zstandard", reason="the package viser is not installed")


@pytest.fixture(scope="module")
def pick(tmp_path_factory):
    """A run of one episode of Pick."""
    out = tmp_path_factory.mktemp("view") / "run"
    run = ("run", "--agent", "hab_eval:straight_line", "--env", "HabPick-v1", "--episodes", "1")
    assert main([*run, "--out", str(out)]) == 0
    return out


def view(run, *options):
    return main(["view", str(run), *map(str, options)])


@pytest.mark.slow
def test_recording_has_the_bodies_and_every_step(pick, tmp_path):
    assert view(pick, "--episode", 0, "--out", tmp_path / "a.viser") == 0
    data = zstandard.ZstdDecompressor().decompress((tmp_path / "a.viser").read_bytes()[8:])
    recording = msgspec.msgpack.decode(data[8 : 8 + int.from_bytes(data[:8], "little")])
    (episode,) = read_record(pick / "run.json").episodes
    assert recording["durationSeconds"] == pytest.approx(episode.steps / 30 + 1)
    messages = recording["messages"]
    names = {message.get("name") for _, message in messages}
    wanted = {"/robot", "/robot/gripper_link", "/scene/stage", "/marks/0", "/panels/arm"}
    assert wanted <= names
    assert any("drawer" in name for name in names if name)
    # The hand moves in the frame of the robot, in nearly every step.
    moves = [m for _, m in messages if m["type"] == "SetPositionMessage"]
    hand = [m for m in moves if m["name"] == "/robot/gripper_link"]
    assert len(hand) > episode.steps / 2
    assert max(abs(x) for m in hand for x in m["position"]) < 2.0
    # Every mesh of the apartment has its textures: its own file.
    glb = [m for _, m in messages if m["type"] == "GlbMessage"]
    assert len(glb) > 80


def test_bad_input_is_refused_before_the_episode(pick, tmp_path, capsys, monkeypatch):
    (tmp_path / "taken.html").write_text("mine")
    for options, words in (
        ((tmp_path / "no.json", "--episode", 0), "no.json"),
        (("nothing", "--episode", 0), "submission"),
        ((pick, "--episode", 1), "--episode 1: it has to be from 0 to 0"),
        ((pick, "--episode", 0, "--out", tmp_path / "a.png"), ".html or .viser"),
        ((pick, "--episode", 0, "--out", tmp_path / "taken.html"), "taken.html"),
        ((pick, "--episode", 0, "--out", tmp_path / "taken.html" / "a.html"), "taken.html"),
    ):
        assert view(*options) == 2
        out, err = capsys.readouterr()
        assert words in err
        assert "running" not in out
        assert err.count("\n") == 1
    assert (tmp_path / "taken.html").read_text() == "mine"
    for name in [name for name in sys.modules if name in ("hab_eval.view", "hab_tasks.web_scene")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "viser", None)
    assert view(pick, "--episode", 0) == 2
    assert "pip install 'hab-tasks[view]'" in capsys.readouterr().err


@pytest.mark.browser
@pytest.mark.slow
def test_page_plays_without_a_server(pick, tmp_path):
    from playwright.sync_api import sync_playwright

    assert view(pick, "--episode", 0, "--out", tmp_path / "page.html") == 0
    with sync_playwright() as playwright:
        chromium = playwright.chromium.launch(
            executable_path=shutil.which("chromium"),
            args=["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"],
        )
        page, faults, addresses = chromium.new_page(), [], []
        page.on("console", lambda m: m.type == "error" and faults.append(m.text))
        page.on("pageerror", lambda error: faults.append(str(error)))
        page.on("request", lambda request: addresses.append(request.url))
        page.goto((tmp_path / "page.html").as_uri())
        page.wait_for_selector("canvas")
        page.wait_for_selector(".mantine-Slider-root")
        chromium.close()
    assert not faults
    assert not [one for one in addresses if one.split(":")[0] not in ("file", "data", "blob")]
