"""The report shows what the results say, all of it and nothing else, in a browser that asks the network for nothing."""

import base64
import gzip
import json
import math
import os
import shutil
from copy import deepcopy
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from plotly.offline import get_plotlyjs

from agents.evaluation.bootstrap import summary
from experiments.benchmark.formats import gap, share
from experiments.benchmark.leaderboard import board
from experiments.benchmark.summary import flights
from experiments.files import plain
from experiments.paper import figures
from experiments.paper.tables import table_1
from experiments.report import page, race
from experiments.report.charts import DARK, colours, gaps, label, of_problem
from flatgym import SCENARIOS, Quadrotor
from flatgym.scenarios.reference import reference
from flatgym.task.rollout import fly_actions

PUBLISHED = Path(page.__file__).parents[1] / "results" / "published"
EVIL = '</script><script>alert(1)</script><img src=x onerror="alert(2)">'
FAILURE = "ValueError: <b>broken</b> & gone"
FLOWN = 15
"""Flights that are left of each cell."""
HOW_TO = (
    "no Chromium for the report's tests: set FLATQUAD_CHROMIUM to one, or install it by `apt-get install chromium` or "
    "`playwright install chromium --only-shell`"
)


def read(name):
    """Return a published results file."""
    return json.loads((PUBLISHED / name).read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def paper():
    """The paper's results as published."""
    return read("paper.json")


@pytest.fixture(scope="module")
def benchmark():
    """The published study cut down, and agents that it does not know: one evil, one that failed, one half of it."""
    full = read("learners.json")
    kept = {("hoop", "ppo"), ("hoop", "sac"), ("hoop", "pd"), ("random-goal", "bc"), ("random-goal", "expert")}
    cells = [deepcopy(cell) for cell in full["cells"] if (cell["problem"], cell["agent"]) in kept and cell["seed"] < 2]
    for cell in cells:
        cell["flights"] = {name: {"steps": cell["flights"][name]["steps"][:FLOWN]} for name in ("calm", "wind")}
    model = next(cell for cell in cells if cell["agent"] == "pd")
    best = reference("hoop").actions
    failed = {"problem": "hoop", "seed": 0, "flights": {}}
    cells += [
        model | {"agent": EVIL, "actions": best.tolist()},
        model | {"agent": "mine", "actions": best[:20].tolist()},
        failed | {"agent": "mine", "seed": 1, "error": FAILURE},
        failed | {"agent": "theirs", "error": FAILURE},
    ]
    return full | {"cells": cells, "conditions": {name: full["conditions"][name] for name in ("calm", "wind")}}


@pytest.fixture(scope="module")
def html(benchmark, paper):
    """The page of it, with two scenarios to race in, and Fig. 2 in the place of those that need a solver."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(race, "SCENARIOS", {name: SCENARIOS[name] for name in ("hoop", "ground-6")})
        patch.setattr(figures, "FIGURES", dict.fromkeys(figures.FIGURES, figures.fig2))
        return page.page(benchmark, paper)


class Document(HTMLParser):
    """The elements of a page: their tags, attributes, and the text in those with an id."""

    def __init__(self, html):
        super().__init__()
        self.elements, self.texts, self.open, self.words = [], {}, None, []
        self.feed(html)

    def handle_starttag(self, tag, attrs):
        self.elements.append((tag, dict(attrs)))
        self.open = dict(attrs).get("id") if tag == "script" else None

    def handle_data(self, data):
        self.words.append(data)
        if self.open:
            self.texts[self.open] = self.texts.get(self.open, "") + data

    def handle_endtag(self, _):
        self.open = None


@pytest.fixture(scope="module")
def document(html):
    return Document(html)


@pytest.fixture(scope="module")
def numbers(document):
    """The data block."""
    return json.loads(document.texts["numbers"])


def test_every_cell_has_its_line_and_no_list_of_agents_is_needed(benchmark, numbers):
    wanted = {(cell["problem"], cell["agent"]) for cell in benchmark["cells"]}
    lines = [(line["problem"], line["agent"]) for line in numbers["leaderboard"]]
    assert set(lines) == wanted
    assert len(lines) == len(wanted)
    names = [line["name"] for line in numbers["leaderboard"] if line["problem"] == "hoop"]
    assert names == ["PPO", "SAC", "cascaded PD", EVIL, "mine", "theirs"]


def test_scores_are_those_of_the_intervals_against_k_star(benchmark, numbers):
    rows = flights(benchmark | {"cells": [cell for cell in benchmark["cells"] if cell["flights"]]})
    for line in numbers["leaderboard"]:
        calm = rows[(rows["scenario"] == line["problem"]) & (rows["agent"] == line["agent"])]
        calm = calm[calm["condition"] == "calm"]
        if len(calm):
            (wanted,) = plain(summary(calm).to_dict("records"))
            found = {"success_rate": line["success"]} | line
            assert {key: found[key] for key in wanted if key in found} == {k: wanted[k] for k in wanted if k in found}
    pd = next(line for line in numbers["leaderboard"] if line["agent"] == "pd")
    assert pd["gap"] == pytest.approx(pd["steps"] / reference("hoop").k_star - 1)


def test_failures_are_told_and_not_dropped(document, numbers):
    lines = {line["agent"]: line for line in numbers["leaderboard"]}
    assert lines["theirs"]["errors"] == [f"seed 0: {FAILURE}"]
    assert lines["theirs"]["flights"] == 0
    assert lines["mine"]["errors"] == [f"seed 1: {FAILURE}"]
    assert lines["mine"]["flights"] > 0
    assert document.words.count(f"seed 0: {FAILURE}") == document.words.count(f"seed 1: {FAILURE}") == 1
    assert document.words.count("failed") == 1


def test_a_study_in_which_everything_failed_is_still_a_report(benchmark):
    found = board(benchmark | {"cells": [cell for cell in benchmark["cells"] if not cell["flights"]]})
    assert [line.failed for line in found.lines] == [True, True]
    assert not found.standings
    assert not found.curves
    assert list(of_problem(found, "hoop", benchmark["conditions"])) == ["gap"]


def test_what_comes_from_data_is_text(document):
    assert EVIL in document.words
    assert "img" not in {tag for tag, _ in document.elements}
    assert not [name for _, attributes in document.elements for name in attributes if name.startswith("on")]
    scripts = [attributes for tag, attributes in document.elements if tag == "script"]
    assert [one.get("id") for one in scripts if "id" in one] == ["numbers", "races", "figures", "plotly"]
    assert len(scripts) == 4 + len((page.THEME, *page.SCRIPTS))
    for block in ("numbers", "races", "figures", "plotly"):
        assert "<" not in document.texts[block]


def test_plotly_gets_names_without_a_meaning_and_of_a_bearable_length():
    assert label("<a href='x'>") == "&lt;a href=&#x27;x&#x27;&gt;"
    assert label("long" * 99).endswith("…")
    assert set(colours(["ppo", "pd", "mine"]).values()) <= set(DARK)


def test_the_page_asks_for_nothing(document, html):
    assert {"http-equiv": "Content-Security-Policy"}.items() <= next(
        attributes for tag, attributes in document.elements if tag == "meta" and "http-equiv" in attributes
    ).items()
    asked = [attributes[key] for _, attributes in document.elements for key in ("src", "href") if key in attributes]
    assert all(address.startswith(("#", "data:")) for address in asked)
    assert "@import" not in html
    assert "url(" not in html.replace(document.texts["plotly"], "")


def test_plotly_is_packed_whole(document):
    assert gzip.decompress(base64.b64decode(document.texts["plotly"])).decode() == get_plotlyjs()


def test_the_same_results_make_the_same_page_written_whole(tmp_path, monkeypatch):
    monkeypatch.setattr(page, "page", lambda benchmark, paper: f"<p>{benchmark} {paper} \N{GREEK SMALL LETTER PI}</p>")
    path = page.write(tmp_path / "report.html", {"a": 1}, {"b": 2})
    assert path == tmp_path / "report.html"
    assert path.read_text(encoding="utf-8").startswith("<p>{'a': 1} {'b': 2} \N{GREEK SMALL LETTER PI}")
    assert list(tmp_path.iterdir()) == [path]


def test_table_1_is_the_papers_with_bounds_that_stay_bounds(paper, numbers):
    rows = numbers["table_1"]
    assert rows == plain(table_1(paper))
    for row, source, judged in zip(rows, paper["rows"], paper["judged"], strict=True):
        assert {key: row[key] for key in ("printed_s", "nodes_only_s", "shooting_s")} == {
            key: source[key] for key in ("printed_s", "nodes_only_s", "shooting_s")
        }
        assert source["lower_bound_s"] - 1e-5 < row["lower_bound_s"] <= source["lower_bound_s"]
        assert row["verdict"].startswith("impossible by") == bool(judged["impossible"])
    assert [row["verdict"] for row in table_1({"rows": paper["rows"][:1]})] == ["-"]


def test_races_are_the_environments_flights(document, benchmark):
    races = json.loads(document.texts["races"])
    assert races["first"] == "hoop"
    named = {flight["name"]: flight for flight in races["scenarios"]["hoop"]["flights"]}
    assert list(named) == ["best known, K* = 70", EVIL, "mine", "pretrained policy", "cascaded PD"]
    for name, actions in (
        ("best known, K* = 70", reference("hoop").actions),
        ("mine", benchmark["cells"][-3]["actions"]),
    ):
        flown = fly_actions(SCENARIOS["hoop"], np.array(actions, dtype=np.float32))
        states = np.concatenate([situation.state for situation in flown])
        np.testing.assert_allclose(named[name]["states"], states, atol=0.5001 * 10**-race.DIGITS)
        assert named[name]["steps"] == len(states) - 1 == len(named[name]["controls"])
    assert named[EVIL]["told"] == "goal in 70 steps, K* = 70, gap 0 %"
    assert named["mine"]["told"] == "flying after 20 steps, K* = 70"
    assert named["mine"]["gap"] is None
    assert named["cascaded PD"]["gap"] == pytest.approx(named["cascaded PD"]["steps"] / 70 - 1)


def test_whoever_has_ended_does_not_go_on():
    scenario, best = SCENARIOS["ground-6"], reference("ground-6")
    falls = np.full((40, 2), -1.0)
    longer = np.concatenate([best.actions, falls])
    one, other = race.flown(scenario, [longer, falls], ["one", "other"], best.k_star)
    assert (one.outcome, one.steps, one.gap) == ("goal", best.k_star, 0.0)
    assert other.outcome == "floor"
    assert other.steps < 40
    assert "floor after" in other.told()


@pytest.mark.parametrize("actions", [[], [[0.0]], [[0.0, math.nan]], [0.0, 0.0]])
def test_actions_that_cannot_be_flown_are_refused(actions):
    with pytest.raises(ValueError, match=r"actions of 'mine' in 'hoop' must be finite, of shape \(K, 2\)"):
        race.flown(SCENARIOS["hoop"], [actions], ["mine"], 70)


def test_nothing_depends_on_what_is_known(benchmark):
    line = board(benchmark).lines[0]
    unknown = replace(line, gap=math.nan, k_star=math.nan)
    assert page.scored(unknown)[5] == page.Cell("-", None)
    assert gaps("hoop", [unknown]).figure["layout"]["annotations"][0]["text"] == "K* unknown"
    assert page.spoken({"calm": {}, "gusts": {"gusts": 0.5}}).endswith("gusts: gusts 0.5.")
    assert page.spoken({"calm": {}}) == ""


def test_every_agent_has_its_place_in_the_plot_of_gaps(benchmark):
    lines = [line for line in board(benchmark).lines if line.problem == "hoop"]
    chart = gaps("hoop", lines)
    points, notes = chart.figure["data"][0]["y"], [note["text"] for note in chart.figure["layout"]["annotations"]]
    assert len(points) + len(notes) == len(lines)
    assert notes == ["never at the goal", "failed"]


# ---- in a browser -----------------------------------------------------------------------------------------------


def chromium(playwright):
    """Return the path of a Chromium; a test without one fails and says how to get it."""
    own = playwright.chromium.executable_path
    names = ("chromium", "chromium-browser", "google-chrome")
    found = os.environ.get("FLATQUAD_CHROMIUM") or next(filter(None, map(shutil.which, names)), None)
    if not found and not Path(own).exists():
        pytest.fail(HOW_TO)
    return found or own


def test_without_a_chromium_one_is_told_how_to_get_it(monkeypatch, tmp_path):
    monkeypatch.delenv("FLATQUAD_CHROMIUM", raising=False)
    monkeypatch.setattr(shutil, "which", lambda _: None)
    own = SimpleNamespace(chromium=SimpleNamespace(executable_path=str(tmp_path / "none")))
    with pytest.raises(pytest.fail.Exception, match="playwright install chromium --only-shell"):
        chromium(own)
    monkeypatch.setenv("FLATQUAD_CHROMIUM", "/mine")
    assert chromium(own) == "/mine"


@pytest.fixture(scope="module")
def browser():
    """One browser for all tests."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        running = playwright.chromium.launch(executable_path=chromium(playwright))
        yield running
        running.close()


@pytest.fixture(scope="module")
def file(html, tmp_path_factory):
    """The page on disk."""
    path = tmp_path_factory.mktemp("report") / "report.html"
    path.write_text(html, encoding="utf-8")
    return path


class Window:
    """The page in a window, and what it complained of and asked for."""

    def __init__(self, browser, file, **settings):
        self.tab, self.complaints, self.asked = browser.new_context(**settings).new_page(), [], []
        self.tab.on("console", lambda message: self.complaints.append(message.text))
        self.tab.on("pageerror", lambda error: self.complaints.append(str(error)))
        self.tab.on("request", lambda request: self.asked.append(request.url))
        self.tab.goto(file.as_uri())
        self.painted = self.tab.evaluate(PAINT)

    def used(self, file):
        """Yield the tab for a test; afterwards nothing may have gone wrong, and nothing but the file been asked for."""
        yield self.tab
        assert self.complaints == []
        assert {url for url in self.asked if not url.startswith("data:")} == {file.as_uri()}


PAINT = """new Promise(tell => new PerformanceObserver((list, observer) => {
    const [entry] = list.getEntriesByName("first-contentful-paint");
    if (entry) { observer.disconnect(); tell(entry.startTime); }
}).observe({ type: "paint", buffered: true }))"""
"""When the first words were seen [ms]."""


@pytest.fixture(scope="module")
def desk(browser, file):
    """A wide window, one for all tests: unpacking Plotly takes seconds where the processor is busy."""
    return Window(browser, file, viewport={"width": 1200, "height": 800})


@pytest.fixture(scope="module")
def pocket(browser, file):
    """A phone."""
    return Window(browser, file, viewport={"width": 360, "height": 740}, is_mobile=True, has_touch=True)


@pytest.fixture
def tab(desk, file):
    yield from desk.used(file)


@pytest.fixture
def phone(pocket, file):
    yield from pocket.used(file)


def drawn(tab, selector):
    """Wait until a figure is drawn, and return its place."""
    place = tab.locator(selector).first
    place.evaluate("place => place.scrollIntoView({ behavior: 'instant' })")
    place.locator("svg.main-svg").first.wait_for(timeout=20_000)
    return place


def test_it_is_small_and_soon_there_and_draws_itself(tab, desk, file):
    if desk.painted >= 1000:  # the machine may have been busy
        tab.reload()
        desk.painted = tab.evaluate(PAINT)
    assert desk.painted < 1000
    assert file.stat().st_size < 6e6
    for name in ("gap", "learning", "robustness", "figure-4"):
        drawn(tab, f"figure.{name} .chart")
    assert EVIL[:10] in drawn(tab, "figure.gap .chart").text_content()


def test_the_numbers_shown_are_those_of_the_data(tab, numbers):
    read_table = "id => [...document.querySelectorAll(`#${id} tbody tr`)].map(r => [...r.cells].map(c => c.innerText))"
    shown = {(row[0], row[1].split("\n")[0]): row for row in tab.evaluate(read_table, "leaderboard")}
    assert len(shown) == len(numbers["leaderboard"])
    for line in numbers["leaderboard"]:
        row = shown[line["problem"], line["name"]]
        if not line["flights"]:
            assert row[2:] == ["failed", *["-"] * 6]
            continue
        values = {key: math.nan if value is None else value for key, value in line.items()}
        values["success_rate"] = values["success"]
        steps = "-" if line["steps"] is None else f"{line['steps']:.4g}"
        assert row[2:6] == [share(values), gap(values), steps, f"{line['k_star']:.4g}"]
        assert row[8] == (f"{line['learning_s']:.0f}" if line["learning_s"] else "-")
    for row, line in zip(tab.evaluate(read_table, "table-1"), numbers["table_1"], strict=True):
        printed = [line["scenario"], "-" if line["printed_s"] is None else f"{line['printed_s']:g}"]
        times = [f"{line[key]:.4f}" for key in ("nodes_only_s", "flat_certified_s")]
        times += [f"{line[key]:.5f}" for key in ("shooting_s", "lower_bound_s")]
        assert row == [*printed, *times, line["verdict"]]


def test_headings_sort_by_mouse_and_keyboard_and_a_problem_can_be_picked(tab):
    values = "[...document.querySelectorAll('#leaderboard tbody tr')].map(row => row.cells[3].dataset.value)"
    heading = tab.locator("#leaderboard th", has_text="gap to K*")

    def column():
        texts = tab.evaluate(values)
        there = [float(text) for text in texts if text]
        assert "" not in texts[: len(there)], "what has no value stands last"
        return there

    heading.locator("button").click()
    assert heading.get_attribute("aria-sort") == "ascending"
    rising = column()
    assert rising == sorted(rising)
    heading.locator("button").press("Enter")
    assert heading.get_attribute("aria-sort") == "descending"
    assert column() == rising[::-1]
    tab.select_option("#problem", "random-goal")
    assert set(tab.locator("#leaderboard tbody tr:visible td:first-child").all_inner_texts()) == {"random-goal"}
    tab.select_option("#problem", "")


def test_a_race_plays_and_scrubs_by_mouse_and_keyboard(tab):
    track, scene = tab.locator("#track"), tab.locator("#scene")

    def time():
        return float(tab.locator("#time").input_value())

    def picture():
        return scene.evaluate("canvas => canvas.toDataURL()")

    assert tab.locator("#told-two").inner_text().startswith("goal in 107 steps, K* = 70, gap +52.9 %")
    before = picture()
    scene.focus()
    assert scene.evaluate("canvas => getComputedStyle(canvas).outlineStyle") == "solid"
    tab.keyboard.press("Space")
    tab.wait_for_selector("#play[aria-label=Pause]")
    tab.wait_for_timeout(300)
    tab.keyboard.press("Space")
    assert tab.locator("#play").get_attribute("aria-label") == "Play"
    paused = time()
    assert paused > 0
    assert picture() != before
    tab.wait_for_timeout(100)
    assert time() == paused
    tab.keyboard.press("ArrowRight")
    assert time() == math.floor(paused) + 1
    tab.keyboard.press("Shift+ArrowLeft")
    assert time() == max(0, math.floor(paused) - 9)
    tab.keyboard.press("+")
    tab.keyboard.press("+")
    assert tab.locator("#speed").input_value() == "2"
    tab.keyboard.press("-")
    assert tab.locator("#speed").input_value() == "1"
    tab.locator("#time").fill("80")
    assert tab.locator("#step-one").inner_text() == "step 70 of 70"
    assert tab.locator("#step-two").inner_text() == "step 80 of 107"
    assert track.locator(".ended").count() == 1
    tab.locator("#time").fill("105")
    tab.locator("#play").click()
    tab.wait_for_selector("#play[aria-label=Play]")
    assert "goal in 70 steps" in tab.locator("#said").text_content()
    tab.select_option("#scenario", label="ground-6")
    assert time() == 0
    assert "proven" in tab.locator("#known").inner_text()
    tab.select_option("#scenario", label="hoop")
    tab.select_option("#two", label="mine")
    assert tab.locator("#told-two").inner_text() == "flying after 20 steps, K* = 70"


def test_between_steps_the_vehicle_flies_its_closed_form(tab):
    generator = np.random.default_rng(0)
    states = generator.normal(size=(40, 5))
    controls = np.column_stack([generator.uniform(1, 20, 40), generator.uniform(-10, 10, 40)])
    durations = np.concatenate([generator.uniform(0, 0.02, 30), generator.uniform(0.1, 0.4, 10)])
    there = tab.evaluate(
        "([states, controls, times]) => states.map((s, i) => Flight.exact(s, controls[i], times[i], 9.81))",
        [states.tolist(), controls.tolist(), durations.tolist()],
    )
    np.testing.assert_allclose(there, Quadrotor().step(states, controls, durations), rtol=0, atol=1e-12)


def test_a_phone_needs_not_be_turned(phone):
    drawn(phone, "figure.learning .chart")
    assert phone.evaluate("document.documentElement.scrollWidth") == 360
    beyond = """[...document.querySelectorAll("body *")]
        .filter(element => !element.closest(".scroll") && element.getBoundingClientRect().right > 361)
        .map(element => element.outerHTML.slice(0, 80))"""
    assert phone.evaluate(beyond) == []
    assert phone.locator("figure.gap .chart").first.bounding_box()["width"] <= 340


def test_the_dark_changes_page_figures_and_race(tab):
    drawn(tab, "figure.gap .chart")
    looks = """[getComputedStyle(document.body).backgroundColor, document.getElementById("scene").toDataURL(),
        getComputedStyle(document.querySelector("figure.gap .xtick text")).fill]"""

    def seen(theme):
        tab.wait_for_selector(f"html[data-theme={theme}]", state="attached")
        tab.evaluate("new Promise(frame => requestAnimationFrame(() => requestAnimationFrame(frame)))")
        return tab.evaluate(looks)

    light = seen("light")
    tab.emulate_media(color_scheme="dark")
    dark = seen("dark")
    assert all(one != other for one, other in zip(light, dark, strict=True))
    tab.locator("#theme").click()
    assert seen("light") == light
    tab.emulate_media(color_scheme="light")
    tab.locator("#theme").click()
    assert seen("dark") == dark, "what was chosen counts more than what the system wishes"
    tab.locator("#theme").click()


def test_where_motion_is_to_be_reduced_the_race_shows_its_end_and_jumps(phone):
    phone.emulate_media(reduced_motion="reduce")
    phone.select_option("#scenario", label="ground-6")
    time, last = phone.locator("#time"), reference("ground-6").k_star
    assert float(time.input_value()) == float(time.get_attribute("max")) >= last
    phone.locator("#play").click()
    phone.wait_for_timeout(700)
    phone.locator("#play").click()
    assert 0 < float(time.input_value()) < last
    assert float(time.input_value()) % 5 == 0
