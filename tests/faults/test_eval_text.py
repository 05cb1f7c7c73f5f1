"""Free text of a submission is displayed verbatim, and everything written can be read back."""

import html
import json
import random
import re
from dataclasses import replace
from html.parser import HTMLParser

import pytest
import stub_runs  # first: it finds the stub

import stub_hab  # isort: skip
import torch
from hab_eval import plain_text
from hab_eval.errors import AgentError, ResultError
from hab_eval.failures import draw_failures, failure_table
from hab_eval.leaderboard import build_groups, to_html, to_markdown
from hab_eval.plain_text import figure_text, plain
from hab_eval.progress import describe
from hab_eval.report import leaderboard_tables, result_table
from hab_eval.results import read_record, summarize, write_record
from hab_eval.run_folder import RunFolder
from hab_eval.runner import run_episode
from hab_eval.site.agents import agent_pages
from hab_eval.site.breakdown import Receptacles
from hab_eval.site.build import plain_values, write_pages
from hab_eval.site.comparison import comparison_sets
from hab_eval.site.datasets import dataset_pages
from hab_eval.site.entries import make_entries
from hab_eval.site.pages import Site, all_pages
from markdown_it import MarkdownIt
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from stub_runs import make_record

from hab_tasks.agent import AgentReport, AgentSpec
from hab_tasks.errors import OptionError, RunStoppedError

NAMES = (
    *("PPO [/v2]", "[red]PPO[/red]", "[link=https://x]PPO[/link]", r"\[bold]", ":smile:"),  # rich
    *(r"$\frac{1}{$", "$x^2$", r"$\undefined$", "10$ and 20$", r"\$x", "_legend"),  # matplotlib
    *("<script>alert(1)</script>", "<img src=x onerror=alert(1)>", "&lt;b&gt; &amp;#60;"),  # HTML
    *("<!-- hidden", '"\' onload="x'),
    *("![x](https://example.org/x.png)", "[x](https://example.org)", "[x][y] and [x]: y"),  # links
    *("<https://example.org>", "https://example.org/a_b www.example.org", "me@example.org"),
    *("a|b||c", r"a\|b", "`a` ``b`` ```", "*a* **b** ***", "_a_ __b__ a_b_c _", "~~a~~"),
    *("# a #", "a ##", "- a", "> a", "a\\", r"\\*a\\*", "a\nb", "a\n\n# b", "a\rb", "a\tb"),
    *("\x1b[31mred\x1b]8;;https://x\x07", "a\0b", "a\u202eb", "a\u2028b"),  # control characters
    *("Ünïcödé 机器人", "x" * 500),
)
"""Names that a terminal, a figure, HTML or Markdown could take for markup."""


SITE_TAGS = {
    *("html", "head", "meta", "title", "link", "script", "body", "header", "nav", "main", "footer"),
    *("h1", "h2", "p", "a", "b", "small", "code", "abbr", "div", "span", "section", "ul", "li"),
    *("label", "input", "select", "option", "button", "output", "form", "dialog", "details"),
    *("summary", "table", "thead", "tbody", "tr", "th", "td", "dl", "dt", "dd"),
    *("svg", "rect", "path"),
}
LINK = r"[\w./&#-]+|data:,|https://arxiv.org/abs/2106.14405"
DATA = r'<script type="application/json" id="data">(.*?)</script>'


def labelled(text):
    """A record whose free text is all the same."""
    episodes = tuple(
        replace(one, scene=text, stages={text: one.success}, failure=one.failure and text)
        for one in make_record().episodes
    )
    timings_s = {"e0": {text: 1.0}}
    return replace(
        make_record(),
        agent_name=text,
        env=text,
        scene_dataset=text,
        objects=text,
        split=text,
        options={text: text},
        versions={"hab-tasks": text},
        git=None,
        device=text,
        control_mode=text,
        episodes=episodes,
        timings_s=timings_s,
        summary=summarize(episodes, timings_s),
    )


def test_a_terminal_shows_the_text(subtests, capsys, monkeypatch):
    for text in NAMES:
        with subtests.test(text=text):
            monkeypatch.setattr(plain_text, "LOG_WIDTH", 20_000)
            shown = labelled(text)
            groups = build_groups({"x.json": shown})
            for table in (result_table(shown), failure_table([shown]), *leaderboard_tables(groups)):
                plain_text.show(table)
                out = capsys.readouterr().out
                assert plain(text) in out
                assert "\x1b" not in out
                assert "\0" not in out


def test_a_log_shows_the_text_on_one_line(subtests):
    for text in NAMES:
        with subtests.test(text=text):
            line = describe(labelled(text).episodes[1])
            assert plain(text) in line
            assert len(line.splitlines()) == 1
            assert line.isprintable()


def test_markdown_shows_the_text_and_nothing_else(subtests):
    for text in NAMES:
        with subtests.test(text=text):
            written = to_markdown(build_groups({"x.json": labelled(text)}))
            assert len(written.splitlines()) == 12
            parser = MarkdownIt("commonmark").enable(["table", "strikethrough"])
            page = parser.render(written)
            tags = set(re.findall(r"</?([a-z0-9]+)", page))
            assert tags <= {"h1", "h2", "p", "table", "thead", "tbody", "tr", "th", "td", "code"}
            assert page.count("<code>") == 2  # our own words
            assert page.count("<tr>") == 2
            assert page.count("<td>") == 9
            told = " ".join(html.unescape(re.sub(r"<[^>]*>", "", page)).split())
            assert " ".join(plain(text).split()) in told
            assert "://" not in written  # nothing becomes a link by itself
            assert "www." not in written
            assert not re.search(r"(?<!\\)[@$#]\w", written)


def test_a_page_shows_the_text_and_nothing_else(subtests):
    for text in NAMES:
        with subtests.test(text=text):
            page = to_html(build_groups({"x.json": labelled(text)}))
            tags = set(re.findall(r"<[/!]?([a-zA-Z0-9]+)", page))
            known = "doctype html meta title style h1 h2 p table tr th td"
            assert tags <= set(known.split())
            cells = re.findall(r"<td>(.*?)</td>", page)
            assert html.unescape(cells[0]).startswith(plain(text))
            assert len(cells) == 9


class Reader(HTMLParser):
    """Collects the tags, the attributes that run or load something, and the text of a page."""

    def __init__(self):
        super().__init__()
        self.tags, self.links, self.words, self._skipped = set(), [], [], False

    def handle_starttag(self, tag, attrs):
        self.tags.add(tag)
        self.links += [v for k, v in attrs if k in ("href", "src", "poster", "action")]
        assert not [k for k, _ in attrs if k.startswith("on")], attrs
        self._skipped = tag == "script"

    def handle_endtag(self, tag):
        self._skipped = False

    def handle_data(self, data):
        if not self._skipped:
            self.words.append(data)


def test_a_site_shows_the_text_and_nothing_else(subtests, tmp_path):
    for text in NAMES:
        with subtests.test(text=text):
            records = {f"{number}.json": labelled(text) for number in range(2)}
            entries = make_entries(records)
            site = Site(
                entries=entries,
                sets=comparison_sets(entries),
                agents=agent_pages(entries, []),
                datasets=dataset_pages(entries, tmp_path),
                receptacles=Receptacles(),
                studies=[],
                videos={},
                docs=tmp_path,
            )
            pages = all_pages(site)
            write_pages(tmp_path, pages)
            assert len(pages) == 11
            for page in pages:
                written = (tmp_path / page.path).read_text()
                read = Reader()
                read.feed(written)
                assert read.tags <= SITE_TAGS, page.path
                for link in read.links:
                    assert re.fullmatch(
                        r"[\w./&#-]+|data:,|https://arxiv.org/abs/2106.14405", link
                    ), link
                if page.path in ("index.html", "runs/0.html", "compare/index.html"):
                    assert plain(text) in " ".join(read.words)
                assert "\x1b" not in written
                assert "\u202e" not in written
                block = re.search(
                    r'<script type="application/json" id="data">(.*?)</script>', written
                )
                assert (block is None) == (page.data is None)
                if block is not None:
                    assert json.loads(block[1]) == json.loads(json.dumps(plain_values(page.data)))


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:Glyph")  # the font has no Chinese
def test_a_figure_shows_the_text(subtests, tmp_path):
    for text in NAMES:
        with subtests.test(text=text):
            draw_failures([labelled(text), labelled("other")], tmp_path / "x.png")
            assert (tmp_path / "x.png").stat().st_size > 1000
            figure = Figure()
            canvas = FigureCanvasAgg(figure)
            (line,) = figure.subplots().plot([0, 1], label=figure_text(text))
            legend = figure.axes[0].legend()
            assert [one.get_text() for one in legend.get_texts()] == [figure_text(text)]
            canvas.draw()
            (one,) = legend.get_texts()
            drawn, is_math = one._preprocess_math(one.get_text())
            assert (drawn.strip(), is_math) == (plain(text).strip(), False)
            assert line.get_label() == figure_text(text)


def test_it_is_read_as_it_was_written(subtests, tmp_path):
    for text in NAMES:
        with subtests.test(text=text):
            write_record(tmp_path / "run.json", labelled(text))
            assert read_record(tmp_path / "run.json") == labelled(text)


ODD = ["x", "", " ", "\0", "\n", "é", "\ud800", "\udfff", "😀", "\u202e", '"', "\\", "[/]", "$"]
VALUES = [None, 0, 1, -1, 0.5, -0.5, True, 5, 10**400, 1e308, -1e308, 1e100, 2e100]
VALUES += [float("nan"), float("inf"), float("-inf"), "x", "", "\ud800", [], {}, (1,), b"x"]


def odd_text(rng):
    return "".join(rng.choices(ODD, k=rng.randrange(6)))


def odd_value(rng, depth=0):
    kind = rng.randrange(10)
    if kind < 6 or depth > 3:
        return rng.choice(VALUES)
    if kind < 8:
        return odd_text(rng)
    more = [odd_value(rng, depth + 1) for _ in range(rng.randrange(3))]
    return more if kind == 8 else {odd_text(rng): value for value in more}


def odd_report(rng):
    failure = rng.choice([None, odd_text(rng), odd_value(rng)])
    timings_s = {odd_text(rng): rng.choice([0.5, odd_value(rng)]) for _ in range(rng.randrange(3))}
    trace = tuple({odd_text(rng): odd_value(rng)} for _ in range(rng.randrange(3)))
    return AgentReport(failure=failure, timings_s=rng.choice([timings_s, {}]), trace=trace)


def played(rng):
    """An episode of an agent that reports and earns odd things, or how it was refused."""
    agent, env = stub_hab.StubAgent(), stub_hab.StubEnv(render=False)
    told, pay = odd_report(rng), rng.choice([0.5, 0.5, 1e308, float("nan"), float("inf"), 1e99])
    agent.report = lambda: [told]
    agent.act = lambda obs: torch.full((1, 2), pay, dtype=torch.float64)
    episode = stub_hab.StubEpisode(id="e", scene_id="s", seed=rng.randrange(6))
    return run_episode(env, agent, 0, episode)


def test_whatever_is_written_can_be_read(tmp_path):
    """400 reports of odd values: each is refused, or kept and read back as it was."""
    rng = random.Random(0)
    kept = refused = 0
    for number in range(400):
        folder = RunFolder(root=tmp_path / str(number))
        folder.root.mkdir()
        try:
            finished = played(rng)
        except (AgentError, ResultError, RunStoppedError):
            refused += 1
            continue
        kept += 1
        folder.append(finished)
        assert folder.read_journal() == {"e": replace(finished, trace=())}
        folder.cut_traces(["e"])
        timings_s = {"e": finished.timings_s} if finished.timings_s else {}
        episodes = (finished.episode,)
        whole = replace(
            make_record(),
            episodes=episodes,
            timings_s=timings_s,
            summary=summarize(episodes, timings_s),
        )
        write_record(folder.record_path, whole)
        assert read_record(folder.record_path) == whole
    assert min(kept, refused) > 40


def test_whatever_configuration_is_made_can_be_read(tmp_path):
    from hab_eval.config import EvalConfig, SavedConfig, parse_options, read_config, write_config

    rng, kept = random.Random(1), 0
    for number in range(200):
        path = tmp_path / f"{number}.json"
        pairs = [f"{odd_text(rng)}={odd_text(rng)}" for _ in range(rng.randrange(3))]
        try:
            config = EvalConfig(
                agent=odd_text(rng),
                env=odd_text(rng),
                split=rng.choice([None, odd_text(rng)]),
                episodes=rng.choice([1, 5, 5, 10**6]),
                seed=rng.choice([0, 2**63 - 1, 2**63 - 1, -1]),
                options=parse_options(pairs),
                step_timeout_s=rng.choice([None, 0.5, 5.0, float("nan")]),
            )
        except OptionError:
            continue
        kept += 1
        saved = SavedConfig(config=config, versions={"python": "3.11"}, git=None)
        write_config(path, saved)
        assert read_config(path) == saved
    assert kept > 10


def test_obs_modes_are_those_of_maniskill():
    from itertools import combinations

    from hab_eval.agent_checks import OBS_MODES, OBS_PARTS, _is_obs_mode
    from mani_skill.envs.utils.observations import parse_obs_mode_to_struct

    words = [*OBS_MODES, *OBS_PARTS, "foo", ""]
    for mode in [*words, *("+".join(pair) for pair in combinations(words, 2))]:
        try:
            parse_obs_mode_to_struct(mode)
            known = True
        except AssertionError:
            known = False
        assert _is_obs_mode(mode) == known, mode
    assert AgentSpec(name="x", control_mode="ee").obs_mode in OBS_MODES
    assert stub_runs.STUBS.is_dir()
