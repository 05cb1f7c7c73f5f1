"""The results site in headless Chromium."""

from __future__ import annotations

import shutil
import threading
from dataclasses import replace
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import imageio.v2 as imageio
import numpy as np
import pytest
from hab_eval.records.results import read_record, summarize, video_name, write_record
from hab_eval.site.build import SiteOptions, build_site
from PIL import Image
from site_records import record_of, write_submissions

pytestmark = [pytest.mark.browser, pytest.mark.slow]

AXE = Path(__file__).parent / "vendor" / "axe-core" / "axe.min.js"
HOSTILE = "<img src=x onerror=alert(1)><script>alert(2)</script>\"'&\u202e</script>"
SPA = "spa-pick-apartment-seed0"
PLAYED = """(video) => new Promise((done) => {
  video.muted = true;
  video.addEventListener("ended", () => done(video.currentTime));
  video.play();
})"""
TEMPLATES = f"""index leaderboard runs/{SPA} compare/index agents/index
    runs/tp_spa_priv-tidy_house-apartment-seed5 compare/HabPick-v1-apartment-val-seed-0
    agents/hab_ppo-pick_blind datasets/index datasets/apartment paper""".split()


class _Quiet(SimpleHTTPRequestHandler):
    def log_message(self, *_): ...


@pytest.fixture(scope="module")
def serve():
    """Serves a folder; returns its address."""
    servers = []

    def start(folder):
        handler = partial(_Quiet, directory=str(folder))
        server = ThreadingHTTPServer(("127.0.0.1", 0), handler)
        threading.Thread(target=server.serve_forever, daemon=True).start()
        servers.append(server)
        return f"http://127.0.0.1:{server.server_port}/"

    yield start
    for server in servers:
        server.shutdown()
        server.server_close()


@pytest.fixture(scope="module")
def small(tmp_path_factory, serve):
    """A site of four submissions with a video and a figure."""
    root = tmp_path_factory.mktemp("small")
    submissions = write_submissions(root / "submissions")
    record = read_record(submissions / f"{SPA}.json")
    videos = root / "videos" / SPA
    videos.mkdir(parents=True)
    for index in (0, 8):
        name = video_name(index, record.episodes[index].id)
        frames = [np.full((64, 96, 3), 20 * shade, np.uint8) for shade in range(12)]
        imageio.mimwrite(videos / f"{name}.mp4", frames, fps=30, macro_block_size=2)
        imageio.imwrite(videos / f"{name}.png", frames[5])
    drawn = "<p>not yet</p><script>document.querySelector('p').textContent = 'drawn'</script>"
    (videos / "view_8.html").write_text(drawn)
    (root / "docs").mkdir()
    Image.new("RGB", (1500, 700), "white").save(root / "docs" / "fig06_furniture.png")
    options = SiteOptions(
        out=root / "site", submissions=submissions, videos=videos.parent, checkout=root
    )
    build_site(options)
    return serve(options.out)


@pytest.fixture(scope="module")
def browser():
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        chromium = playwright.chromium.launch(
            executable_path=shutil.which("chromium"), args=["--no-sandbox"]
        )
        yield chromium
        chromium.close()


@pytest.fixture
def open_page(browser):
    """Opens pages; fails on errors in the console, dialogs, and requests to other addresses."""
    contexts, faults, addresses = [], [], []

    def start(address, *, width=1440, scheme="light"):
        context = browser.new_context(viewport={"width": width, "height": 900}, color_scheme=scheme)
        context.grant_permissions(["clipboard-read", "clipboard-write"])
        contexts.append(context)
        page = context.new_page()
        page.on("console", lambda m: m.type in ("error", "warning") and faults.append(m.text))
        page.on("pageerror", lambda error: faults.append(str(error)))
        page.on("dialog", lambda dialog: (faults.append("dialog"), dialog.dismiss()))
        page.on("request", lambda request: addresses.append(request.url))
        page.goto(address)
        return page

    yield start
    for context in contexts:
        context.close()
    assert not faults
    assert not [url for url in addresses if not url.startswith(("http://127.0.0.1:", "data:"))]


def follow(page, link):
    """Clicks a link and waits until the page that it leads to has run its scripts."""
    with page.expect_navigation():
        link.click()


def column(page, name):
    script = "(rows, name) => rows.map((row) => row.dataset[name])"
    return page.locator("tbody.list tr").evaluate_all(script, name)


def test_filters_and_search_combine_and_are_kept_in_the_address(open_page, small):
    page = open_page(f"{small}leaderboard.html")
    page.select_option("[data-filter=env]", "HabPick-v1")
    assert page.locator("#count").inner_text() == "3 of 4 runs"
    page.select_option("[data-filter=kind]", "learned")
    assert column(page, "agent") == ["Blind"]
    again = open_page(page.url)
    assert column(again, "agent") == ["Blind"]
    assert again.locator("[data-filter=kind]").input_value() == "learned"
    page.select_option("[data-filter=privileged]", "yes")
    assert page.locator("#nothing").is_visible()
    page.click("#reset")
    assert page.locator("#count").inner_text() == "4 of 4 runs"
    assert "#" not in page.url
    page.fill("#search", "replica random")
    assert column(page, "agent") == ["Random"]
    nonsense = open_page(f"{small}leaderboard.html#env=<b>&sort=no:way&q=")
    assert nonsense.locator("#count").inner_text() == "4 of 4 runs"


def test_the_command_of_a_row_is_two_clicks_away(open_page, small):
    page = open_page(f"{small}leaderboard.html")
    page.locator("tr[data-agent=Blind] button.rerun").click()
    dialog = page.locator("dialog")
    assert dialog.is_visible()
    dialog.locator(".command", has_text="hab-eval run").locator("button.copy").click()
    dialog.get_by_text("Copied").wait_for()
    copied = page.evaluate("navigator.clipboard.readText()")
    assert copied == (
        "hab-eval run --agent hab_ppo:pick_blind --env HabPick-v1 --split val --episodes 10 "
        "--seed 0 --option 'weights=runs/x y' --out runs/pick_blind-pick-apartment-seed0"
    )
    follow(page, dialog.locator("a", has_text="All details"))
    page.locator(".command", has_text="hab-eval verify").locator("button.copy").click()
    page.get_by_text("Copied").wait_for()
    copied = page.evaluate("navigator.clipboard.readText()")
    assert copied == "hab-eval verify pick_blind-pick-apartment-seed0 --episodes 10"


def test_a_run_has_charts_episodes_videos_and_pages(open_page, small):
    page = open_page(f"{small}runs/{SPA}.html")
    assert page.locator("#return-chart line.ct-bar").count() > 1
    assert page.locator("video").count() == 2  # the first success and the first failure
    assert page.locator("video").first.evaluate(PLAYED) > 0.05
    # Pages of several MB are loaded when they are opened.
    assert [frame.url for frame in page.frames[1:]] == [""]
    page.get_by_text("timeout · 0.0 MB").click()
    page.frame_locator("iframe").get_by_text("drawn").wait_for()
    assert column(page, "id") == [str(number) for number in range(10)]
    page.select_option("[data-filter=outcome]", "timeout")
    assert column(page, "id") == ["8", "9"]
    page.fill("#episode-table input[type=search]", "00009")
    assert column(page, "id") == ["9"]
    links = page.locator("#episode-table a")
    page.fill("#episode-table input[type=search]", "")
    assert links.count() == 1  # of the two videos, that of the failure
    assert page.request.get(links.first.evaluate("(a) => a.href")).ok


def test_two_runs_are_compared_episode_by_episode(open_page, small):
    page = open_page(f"{small}runs/{SPA}.html")
    follow(page, page.locator("#paired + ul a").first)
    names = ("both", "only-first", "only-second", "p-value")
    values = [page.locator(f"#{name}").inner_text() for name in names]
    assert values == ["3", "5", "1", "0.2188"]
    assert "6 of 10 common episodes have different outcomes" in page.inner_text("#verdict")
    assert page.locator("#differences tr").count() == 6
    page.select_option("#first", "1")
    assert page.inner_text("#verdict") == "Choose two different runs."
    page.select_option("#second", "0")
    assert page.locator("#only-first").inner_text() == "1"
    assert "difference -40.0 points" in page.inner_text("#verdict")
    again = open_page(page.url)
    assert again.locator("#only-first").inner_text() == "1"


@pytest.mark.parametrize(("width", "scheme"), [(390, "dark"), (1440, "light")])
def test_pages_are_readable_and_accessible(open_page, small, width, scheme):
    page = open_page(small, width=width, scheme=scheme)
    for path in TEMPLATES:
        page.goto(f"{small}{path}.html")
        check_page(page, path)
    page.goto(small)
    assert page.evaluate("document.documentElement.scrollHeight") <= 900
    assert page.locator(".matrix td b").first.inner_text().strip() == "40 %"
    page.goto(f"{small}leaderboard.html")
    page.locator("button.rerun").first.click()
    check_page(page, "the dialog")


def check_page(page, name):
    overflow = "document.documentElement.scrollWidth - document.documentElement.clientWidth"
    assert page.evaluate(overflow) <= 0, name
    page.evaluate(AXE.read_text(encoding="utf-8"))
    found = page.evaluate("axe.run()")["violations"]
    bad = [
        (one["id"], [node["html"] for node in one["nodes"]][:3])
        for one in found
        if one["impact"] in ("serious", "critical")
    ]
    assert not bad, (name, bad)


def test_hostile_text_is_only_text(open_page, tmp_path, serve):
    base = record_of([None, "x"])
    episodes = tuple(
        replace(one, scene=HOSTILE, failure=one.failure and HOSTILE, stages={HOSTILE: one.success})
        for one in base.episodes
    )
    record = replace(
        base,
        agent_name=HOSTILE,
        agent=f"a:{HOSTILE}",
        env=HOSTILE,
        scene_dataset=HOSTILE,
        options={HOSTILE: HOSTILE},
        episodes=episodes,
        summary=summarize(episodes, {}),
    )
    submissions = tmp_path / "submissions"
    submissions.mkdir()
    for name in ("a<b>.json", "b.json"):
        write_record(submissions / name, record)
    out = tmp_path / "site"
    build_site(SiteOptions(out=out, submissions=submissions, checkout=tmp_path))
    address = serve(out)
    page = open_page(address, width=390)
    for path in sorted(out.rglob("*.html")):
        page.goto(address + path.relative_to(out).as_posix())
        check_page(page, path)
        assert page.locator("main img, main script").count() == 0
    page.goto(f"{address}leaderboard.html")
    shown = HOSTILE.replace("\u202e", "\\u202e")
    assert page.locator("td.agent a").first.inner_text() == shown
    page.locator("button.rerun").first.click()
    assert "<img src=x" in page.locator("dialog code").nth(1).evaluate("(c) => c.textContent")
