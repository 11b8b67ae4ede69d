"""What the report's tests share: small results, their page, and the page in a browser."""

import json
from copy import deepcopy
from html.parser import HTMLParser

import pytest

from experiments.benchmark import tasks
from experiments.files import published
from experiments.paper import figures
from experiments.report import page
from flatgym import SCENARIOS
from flatgym.scenarios.reference import reference

EPISODES = 15
"""Episodes kept of each condition of a cell."""


@pytest.fixture(scope="package")
def evil():
    """A name that would run a script if it were not escaped."""
    return '</script><script>alert(1)</script><img src=x onerror="alert(2)">'


@pytest.fixture(scope="package")
def failure():
    """An error with markup."""
    return "ValueError: <b>broken</b> & gone"


@pytest.fixture(scope="package")
def paper():
    """The paper's results as published."""
    return published("paper.json")


@pytest.fixture(scope="package")
def benchmark(evil, failure):
    """A part of the published study, with unknown agents: one with an evil name, one that failed, one that half did."""
    full = published("learners.json")
    kept = {("hoop", "ppo"), ("hoop", "sac"), ("hoop", "pd"), ("random-goal", "bc"), ("random-goal", "expert")}
    cells = [deepcopy(cell) for cell in full["cells"] if (cell["problem"], cell["agent"]) in kept and cell["seed"] < 2]
    for cell in cells:
        cell["episodes"] = {name: {"steps": cell["episodes"][name]["steps"][:EPISODES]} for name in ("nominal", "wind")}
    model = next(cell for cell in cells if cell["agent"] == "pd")
    best = reference("hoop").actions
    failed = {"problem": "hoop", "seed": 0, "episodes": {}}
    cells += [
        model | {"agent": evil, "actions": best.tolist()},
        model | {"agent": "mine", "actions": best[:20].tolist()},
        failed | {"agent": "mine", "seed": 1, "error": failure},
        failed | {"agent": "theirs", "error": failure},
    ]
    return full | {"cells": cells, "conditions": {name: full["conditions"][name] for name in ("nominal", "wind")}}


@pytest.fixture(scope="package")
def html(benchmark, paper):
    """Its page, with races in two scenarios, and Fig. 2 in place of the figures that need a solver."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(tasks, "SCENARIOS", {name: SCENARIOS[name] for name in ("hoop", "ground-6")})
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


@pytest.fixture(scope="package")
def document(html):
    """The elements of the page."""
    return Document(html)


@pytest.fixture(scope="package")
def numbers(document):
    """The data block."""
    return json.loads(document.texts["numbers"])


@pytest.fixture(scope="package")
def file(html, tmp_path_factory):
    """The page on disk."""
    path = tmp_path_factory.mktemp("report") / "report.html"
    path.write_text(html, encoding="utf-8")
    return path


class Window:
    """The page in a window, with its errors and requests."""

    def __init__(self, browser, file, **settings):
        self.tab, self.errors, self.requests = browser.new_context(**settings).new_page(), [], []
        self.tab.on("console", lambda message: self.errors.append(message.text))
        self.tab.on("pageerror", lambda error: self.errors.append(str(error)))
        self.tab.on("request", lambda request: self.requests.append(request.url))
        self.tab.goto(file.as_uri())
        self.painted = self.first_paint()

    def first_paint(self):
        """Return the time of the first paint [ms]."""
        return self.tab.evaluate(FIRST_PAINT)

    def used(self, file):
        """Yield the tab for a test; afterwards check that it had no errors, and no requests but for the file."""
        yield self.tab
        assert self.errors == []
        assert {url for url in self.requests if not url.startswith("data:")} == {file.as_uri()}


FIRST_PAINT = """new Promise(tell => new PerformanceObserver((list, observer) => {
    const [entry] = list.getEntriesByName("first-contentful-paint");
    if (entry) { observer.disconnect(); tell(entry.startTime); }
}).observe({ type: "paint", buffered: true }))"""
"""Time of the first paint [ms]."""


@pytest.fixture(scope="package")
def desk(browser, file):
    """A wide window, one for all tests: decompressing Plotly takes seconds on a busy machine."""
    return Window(browser, file, viewport={"width": 1200, "height": 800})


@pytest.fixture(scope="package")
def pocket(browser, file):
    """A phone."""
    return Window(browser, file, viewport={"width": 360, "height": 740}, is_mobile=True, has_touch=True)


@pytest.fixture
def tab(desk, file):
    yield from desk.used(file)


@pytest.fixture
def phone(pocket, file):
    yield from pocket.used(file)
