"""Free text of a submission is displayed verbatim."""

import html
import json
import re
from dataclasses import replace
from html.parser import HTMLParser

import pytest
from hab_eval.commands.run import leaderboard_tables, result_table
from hab_eval.records import plain_text
from hab_eval.records.failures import draw_failures, failure_table
from hab_eval.records.leaderboard import build_groups, to_html, to_markdown
from hab_eval.records.plain_text import figure_text, plain
from hab_eval.records.results import summarize, write_record
from hab_eval.run.progress import describe
from hab_eval.site.build import SiteOptions, build_site
from markdown_it import MarkdownIt
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from refusals import check_each
from stub_runs import make_record

NAMES = (
    *("PPO [/v2]", "[link=https://x]PPO[/link]", r"\[bold]", ":smile:"),  # rich
    *("<script>alert(1)</script>", "&lt;b&gt; &amp;#60;", "<!-- hidden", '"\' onload="x'),  # HTML
    *("![x](https://example.org/x.png)", "[x](https://example.org)", "[x][y] and [x]: y"),  # links
    *("<https://example.org>", "https://example.org/a_b www.example.org", "me@example.org"),
    *("a|b||c", r"a\|b", "`a` ``b`` ```", "*a* **b** ***", "_a_ __b__ a_b_c _", "~~a~~"),
    *("# a #", "a ##", "- a", "> a", "a\\", r"\\*a\\*", "a\nb", "a\n\n# b", "a\rb", "a\tb"),
    *("\x1b[31mred\x1b]8;;https://x\x07", "a\0b", "a\u202eb", "a\u2028b"),  # control characters
    *("Ünïcödé 机器人", "x" * 500),
)
"""Names that a terminal, HTML or Markdown could take for markup."""

FOR_FIGURES = (r"$\frac{1}{$", "$x^2$", "10$ and 20$", r"\$x", "_legend", "Ünïcödé 机器人")
FOR_SITES = ("<script>alert(1)</script>", "&lt;b&gt; &amp;#60;", "<!-- hidden", '\'" onload="x')
FOR_SITES += ("a\nb", "\x1b[31mred\x1b]8;;https://x\x07", "a\u202eb")

LINK = r"[\w./&#-]+|data:,|https://arxiv.org/abs/2106.14405"
DATA = r'<script type="application/json" id="data">(.*?)</script>'


def labelled(text):
    """A record whose free text is all the same."""
    fields = ("agent_name", "env", "scene_dataset", "objects", "split", "device", "control_mode")
    record = make_record(**dict.fromkeys(fields, text), options={text: text}, git=None)
    episodes = tuple(
        replace(one, scene=text, stages={text: one.success}, failure=one.failure and text)
        for one in record.episodes
    )
    parts = {"episodes": episodes, "timings_s": {"e0": {text: 1.0}}}
    summary = summarize(**parts)
    return replace(record, versions={"hab-tasks": text}, summary=summary, **parts)


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


class Reader(HTMLParser):
    """Collects tags with the names of their attributes, links, and the text of a page."""

    def __init__(self, page):
        super().__init__()
        self.tags, self.links, self.words, self.last = set(), [], [], ""
        self.feed(page)

    def handle_starttag(self, tag, attrs):
        self.last = tag
        self.tags.add((tag, *(name for name, _ in attrs)))
        self.links += [v for k, v in attrs if k in ("href", "src", "poster", "action")]

    def handle_data(self, data):
        if self.last != "script":
            self.words.append(data)


def test_a_page_and_a_site_show_the_text_and_nothing_else(tmp_path):
    out, records = tmp_path / "site", tmp_path / "records"
    records.mkdir()
    shown = ("index.html", "runs/0.html", "compare/index.html", "table.html")

    def pages(text):
        for name in ("0.json", "1.json"):
            write_record(records / name, labelled(text))
        build_site(SiteOptions(out=out, submissions=records, checkout=tmp_path, force=True))
        (out / "table.html").write_text(to_html(build_groups({"x.json": labelled(text)})))
        for file in out.rglob("*.html"):
            yield str(file.relative_to(out)), file.read_text()

    plain_tags = set().union(*(Reader(page).tags for _, page in pages("plain")))

    def check(text):
        for name, page in pages(text):
            read = Reader(page)
            assert read.tags <= plain_tags
            assert [link for link in read.links if not re.fullmatch(LINK, link)] == []
            assert name not in shown or plain(text) in " ".join(read.words)
            assert not {"\x1b", "\u202e"} & set(page)
            for block in re.findall(DATA, page):
                json.loads(block)

    check_names(check, FOR_SITES)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:Glyph")  # the font has no Chinese
def test_a_figure_shows_the_text(tmp_path):
    def check(text):
        draw_failures([labelled(text), labelled("other")], tmp_path / "x.png")
        figure = Figure()
        figure.subplots().plot([0, 1], label=figure_text(text))
        legend = figure.axes[0].legend()
        FigureCanvasAgg(figure).draw()
        (one,) = legend.get_texts()  # none if matplotlib hides the label
        drawn, is_math = one._preprocess_math(one.get_text())
        assert (drawn.strip(), is_math) == (plain(text).strip(), False)

    check_names(check, FOR_FIGURES)
