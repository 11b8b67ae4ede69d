"""The page holds what the results hold, escaped, in one file without requests."""

import base64
import gzip

from plotly.offline import get_plotlyjs

from experiments.files import plain
from experiments.paper.tables import table_1
from experiments.report import page


def test_text_from_data_is_escaped(document, evil):
    assert evil in document.words
    assert "img" not in {tag for tag, _ in document.elements}
    assert not [name for _, attributes in document.elements for name in attributes if name.startswith("on")]
    scripts = [attributes for tag, attributes in document.elements if tag == "script"]
    assert [one.get("id") for one in scripts if "id" in one] == ["numbers", "races", "figures", "plotly"]
    assert len(scripts) == 4 + len((page.HEAD_SCRIPT, *page.SCRIPTS))
    for block in ("numbers", "races", "figures", "plotly"):
        assert "<" not in document.texts[block]


def test_the_page_makes_no_requests(document, html):
    assert {"http-equiv": "Content-Security-Policy"}.items() <= next(
        attributes for tag, attributes in document.elements if tag == "meta" and "http-equiv" in attributes
    ).items()
    asked = [attributes[key] for _, attributes in document.elements for key in ("src", "href") if key in attributes]
    assert all(address.startswith(("#", "data:")) for address in asked)
    assert "@import" not in html
    assert "url(" not in html.replace(document.texts["plotly"], "")


def test_plotly_is_packed_unchanged(document):
    assert gzip.decompress(base64.b64decode(document.texts["plotly"])).decode() == get_plotlyjs()


def test_the_page_is_written_to_its_path_only(tmp_path, monkeypatch):
    monkeypatch.setattr(
        page, "page", lambda benchmark, paper, *_, **__: f"<p>{benchmark} {paper} \N{GREEK SMALL LETTER PI}</p>"
    )
    path = page.write(tmp_path / "report.html", {"a": 1}, {"b": 2})
    assert path == tmp_path / "report.html"
    assert path.read_text(encoding="utf-8").startswith("<p>{'a': 1} {'b': 2} \N{GREEK SMALL LETTER PI}")
    assert list(tmp_path.iterdir()) == [path]


def test_table_1_is_that_of_the_paper_with_lower_bounds_rounded_down(paper, numbers):
    rows = numbers["table_1"]
    assert rows == plain(table_1(paper))
    for row, source, verdict in zip(rows, paper["rows"], paper["verdicts"], strict=True):
        assert {key: row[key] for key in ("printed_s", "nodes_only_s", "shooting_s")} == {
            key: source[key] for key in ("printed_s", "nodes_only_s", "shooting_s")
        }
        assert source["lower_bound_s"] - 1e-5 < row["lower_bound_s"] <= source["lower_bound_s"]
        assert row["verdict"].startswith("impossible by") == bool(verdict["impossible"])
    assert [row["verdict"] for row in table_1({"rows": paper["rows"][:1]})] == ["-"]
