"""Free text of a submission is displayed verbatim, and everything written can be read back."""

import html
import json
import random
import re
from dataclasses import replace
from html.parser import HTMLParser
from itertools import combinations

import pytest
import stub_runs  # noqa: F401  # first: it finds the stub

import stub_hab  # isort: skip
import torch
from hab_eval import plain_text
from hab_eval.agent_checks import OBS_MODES, OBS_PARTS, _is_obs_mode
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
from mani_skill.envs.utils.observations import parse_obs_mode_to_struct
from markdown_it import MarkdownIt
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from refusals import check_each
from stub_runs import make_record

from hab_tasks.agent import AgentReport, AgentSpec
from hab_tasks.errors import RunStoppedError

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

FOR_FIGURES = (r"$\frac{1}{$", "$x^2$", "10$ and 20$", r"\$x", "_legend", "a\nb", "Ünïcödé 机器人")
FOR_SITES = ("<script>alert(1)</script>", "&lt;b&gt; &amp;#60;", "<!-- hidden", '\'" onload="x')
FOR_SITES += ("a|b||c", "a\nb", "\x1b[31mred\x1b]8;;https://x\x07", "a\0b", "a\u202eb", "x" * 500)

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


def check_names(check, names=NAMES):
    """Checks each name."""
    check_each({repr(name)[:60]: name for name in names}, check)


def test_a_terminal_and_a_log_show_the_text(capsys, monkeypatch):
    monkeypatch.setattr(plain_text, "LOG_WIDTH", 20_000)

    def check(text):
        shown = labelled(text)
        groups = build_groups({"x.json": shown})
        for table in (result_table(shown), failure_table([shown]), *leaderboard_tables(groups)):
            plain_text.show(table)
            out = capsys.readouterr().out
            assert plain(text) in out
            assert not {"\x1b", "\0"} & set(out)
        line = describe(shown.episodes[1])
        assert plain(text) in line
        assert len(line.splitlines()) == 1
        assert line.isprintable()

    check_names(check)


def test_markdown_shows_the_text_and_nothing_else():
    def rendered(text):
        written = to_markdown(build_groups({"x.json": labelled(text)}))
        page = MarkdownIt("commonmark").enable(["table", "strikethrough"]).render(written)
        return written, page, re.findall(r"</?([a-z0-9]+)", page)

    plain_page = rendered("plain")

    def check(text):
        written, page, tags = rendered(text)
        assert len(written.splitlines()) == len(plain_page[0].splitlines())
        assert tags == plain_page[2]
        told = " ".join(html.unescape(re.sub(r"<[^>]*>", "", page)).split())
        assert " ".join(plain(text).split()) in told
        prose = re.sub(r"(?m)^    .*$", "", written)  # without code
        assert not re.search(r"://|www\.|(?<!\\)[@$#]\w", prose)  # nothing becomes a link

    check_names(check)


def test_a_page_shows_the_text_and_nothing_else():
    def tags(page):
        return re.findall(r"<[/!]?([a-zA-Z0-9]+)", page)

    plain_tags = tags(to_html(build_groups({"x.json": labelled("plain")})))

    def check(text):
        page = to_html(build_groups({"x.json": labelled(text)}))
        assert tags(page) == plain_tags
        assert html.unescape(re.findall(r"<td>(.*?)</td>", page)[0]).startswith(plain(text))

    check_names(check)


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


def pages_of(text, folder):
    """Writes the site of two records with a text; returns its pages."""
    entries = make_entries({f"{number}.json": labelled(text) for number in range(2)})
    site = Site(
        entries=entries,
        sets=comparison_sets(entries),
        agents=agent_pages(entries, []),
        datasets=dataset_pages(entries, folder),
        receptacles=Receptacles(),
        studies=[],
        videos={},
        docs=folder,
    )
    pages = all_pages(site)
    write_pages(folder, pages)
    return pages


def test_a_site_shows_the_text_and_nothing_else(tmp_path):
    def read_page(page):
        written = (tmp_path / page.path).read_text()
        read = Reader()
        read.feed(written)
        return written, read

    plain_pages = pages_of("plain", tmp_path)
    plain_tags = set().union(*(read_page(page)[1].tags for page in plain_pages))

    def check(text):
        pages = pages_of(text, tmp_path)
        assert len(pages) == len(plain_pages)
        for page in pages:
            written, read = read_page(page)
            assert read.tags <= plain_tags, page.path
            assert [link for link in read.links if not re.fullmatch(LINK, link)] == []
            if page.path in ("index.html", "runs/0.html", "compare/index.html"):
                assert plain(text) in " ".join(read.words)
            assert not {"\x1b", "\u202e"} & set(written)
            block = re.search(DATA, written)
            assert (block is None) == (page.data is None)
            if block is not None:
                assert json.loads(block[1]) == json.loads(json.dumps(plain_values(page.data)))

    check_names(check, FOR_SITES)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:Glyph")  # the font has no Chinese
def test_a_figure_shows_the_text(tmp_path):
    def check(text):
        draw_failures([labelled(text), labelled("other")], tmp_path / "x.png")
        assert (tmp_path / "x.png").stat().st_size > 1000
        figure = Figure()
        canvas = FigureCanvasAgg(figure)
        figure.subplots().plot([0, 1], label=figure_text(text))
        legend = figure.axes[0].legend()
        canvas.draw()
        (one,) = legend.get_texts()  # none if matplotlib hides the label
        assert one.get_text() == figure_text(text)
        drawn, is_math = one._preprocess_math(one.get_text())
        assert (drawn.strip(), is_math) == (plain(text).strip(), False)

    check_names(check, FOR_FIGURES)


def test_it_is_read_as_it_was_written(tmp_path):
    def check(text):
        write_record(tmp_path / "run.json", labelled(text))
        assert read_record(tmp_path / "run.json") == labelled(text)

    check_names(check)


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
    """200 reports of odd values: each is refused, or kept and read back as it was."""
    rng = random.Random(0)
    kept = refused = 0
    for number in range(200):
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
    assert min(kept, refused) > 20


def test_obs_modes_are_those_of_maniskill():
    words = [*OBS_MODES, *OBS_PARTS, "foo", ""]
    for mode in [*words, *("+".join(pair) for pair in combinations(words, 2))]:
        try:
            parse_obs_mode_to_struct(mode)
            known = True
        except AssertionError:
            known = False
        assert _is_obs_mode(mode) == known, mode
    assert AgentSpec(name="x", control_mode="ee").obs_mode in OBS_MODES
