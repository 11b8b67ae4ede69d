"""The paper's table: what is printed lies, what is certified is flown."""

import json

import pandas as pd
import pytest
from typer.testing import CliRunner

from experiments.cli import app
from experiments.paper import figures, initialisation, runs, verdicts
from experiments.paper import printed as paper_printed
from experiments.paper.comparison import COLUMNS, compare
from experiments.paper.initialisation import INITIALISATION_COLUMNS, initialisation_study
from experiments.paper.printed import PONTRYAGIN, PRINTED
from experiments.paper.verdicts import VERDICT_COLUMNS, check_printed_time
from experiments.publishing.tables import paper as paper_blocks
from flatgym import SCENARIOS
from optimal.direct.shooting import solve_winding


@pytest.fixture(scope="module")
def row():
    return compare("horizontal-3")


@pytest.fixture(scope="module")
def checked():
    """The verdicts on all cases; takes a few seconds."""
    return pd.DataFrame([check_printed_time(name) for name in PRINTED], columns=list(VERDICT_COLUMNS))


def test_the_order_of_the_methods(row):
    assert tuple(row) == COLUMNS
    # What is printed is faster than the optimum; no certified flight is.
    assert row["printed_s"] < row["lower_bound_s"] < row["shooting_s"] < row["flat_certified_s"]
    assert row["flat_certified_s"] < 1.003 * row["shooting_s"]
    assert row["shooting_s"] == pytest.approx(row["reference_8_s"], abs=2e-3)
    assert row["pontryagin_s"] == pytest.approx(row["shooting_s"], rel=1e-4)
    assert row["pontryagin_s"] <= row["shooting_s"]


def test_limits_at_nodes_only_are_no_flight(row):
    assert row["nodes_only_violation"] > 1


def test_reference_8_is_known_where_the_paper_prints_it():
    assert set(PONTRYAGIN) <= set(PRINTED)
    assert all(float(PRINTED[name]) < float(time) for name, time in PONTRYAGIN.items())
    assert all(paper_printed.in_free_space(name) for name in PONTRYAGIN)


def test_no_flight_is_faster_than_the_bound_and_one_is_hardly_slower(checked):
    assert (checked["lower_bound_s"] <= checked["upper_bound_s"]).all()
    assert (checked["gap"] <= paper_printed.MAX_GAP).all()
    assert checked["gap"].tolist() == pytest.approx((checked["upper_bound_s"] / checked["lower_bound_s"] - 1).tolist())


def test_all_printed_times_are_impossible_even_rounded_up(checked):
    reported = checked[checked["printed_s"].notna()]
    assert len(reported) == 7
    assert reported["impossible"].all()
    assert (reported["scenario"].map(PRINTED).map(paper_printed.rounded_up) < reported["lower_bound_s"]).all()


def test_the_shortfall_leads_from_the_printed_time_to_the_bound(checked):
    reported = checked[checked["printed_s"].notna()]
    assert (reported["printed_s"] + reported["shortfall_s"]).tolist() == pytest.approx(
        reported["lower_bound_s"].tolist()
    )
    assert (reported["lower_bound_s"] * (1 - reported["shortfall"])).tolist() == pytest.approx(
        reported["printed_s"].tolist()
    )


def test_a_case_without_a_printed_time_has_no_verdict(checked):
    rows = checked.set_index("scenario")
    assert rows.loc["hoop", ["impossible", "reference_8_impossible"]].tolist() == [None, None]
    assert rows.loc["hoop", ["printed_s", "shortfall_s", "shortfall", "reference_8_s"]].isna().all()
    assert set(rows.index[rows["reference_8_impossible"].notna()]) == set(PONTRYAGIN)


def test_no_flight_of_ours_is_ruled_out_by_a_bound_of_another_proof(checked, row):
    mine = checked.set_index("scenario").loc["horizontal-3"]
    assert row["lower_bound_s"] == pytest.approx(mine["lower_bound_s"], rel=paper_printed.MAX_GAP)
    assert mine["lower_bound_s"] <= min(row[method] for method in ("shooting_s", "flat_certified_s", "pontryagin_s"))


@pytest.mark.parametrize("printed", ["0.8902", "1.223", "1.4", "2"])
def test_a_time_is_impossible_only_if_all_times_printed_so_are(printed):
    digits = len(printed.partition(".")[2])
    longest = paper_printed.rounded_up(printed)
    assert f"{longest - 1e-9:.{digits}f}" == printed != f"{longest + 1e-9:.{digits}f}"
    assert paper_printed.impossible(printed, longest + 1e-9)
    assert not paper_printed.impossible(printed, longest)
    assert not paper_printed.impossible(printed, float(printed))
    assert paper_printed.impossible(None, longest) is None


def test_verdicts_say_how_much_is_missing_and_never_raise_a_bound(checked):
    read = verdicts.verdict_texts(checked).set_index("case")
    assert read["printed"].to_dict() == {name: printed or "-" for name, printed in PRINTED.items()}
    assert (read["lower bound"].astype(float).to_numpy() <= checked["lower_bound_s"].to_numpy()).all()
    assert read.loc["diagonal", "impossible by"] == "0.1220 s, 8.65 %"
    assert read.loc["hoop", "impossible by"] == "-"
    loose = checked.assign(impossible=[False if verdict else None for verdict in checked["impossible"]])
    assert verdicts.verdict_texts(loose)["impossible by"].tolist() == ["not excluded"] * 7 + ["-"]
    assert verdicts.verdict_summary(checked).startswith("7 of the paper's 7 times are impossible, and 1 of the 6 ")
    assert "(horizontal-3)" in verdicts.verdict_summary(checked)
    none = checked.assign(
        reference_8_impossible=[False if known else None for known in checked["reference_8_s"].notna()]
    )
    assert verdicts.verdict_summary(none).endswith("and 0 of the 6 of its reference [8].")


@pytest.mark.parametrize("method", ["shooting", "pontryagin"])
def test_direct_and_indirect_methods_succeed_from_every_default_guess(method):
    found = initialisation_study("horizontal-3", method)
    assert tuple(found) == INITIALISATION_COLUMNS
    assert found["succeeded"] == found["converged"] == found["starts"]
    assert found["best_s"] == pytest.approx(0.8987, abs=2e-4)
    assert min(found["warm_s"], found["cold_s"]) > 0


def test_only_certified_flights_near_the_best_succeed(monkeypatch):
    scenario = SCENARIOS["horizontal-3"]
    direct = solve_winding(scenario, nodes=50)
    slow = solve_winding(scenario, winding=1, nodes=50)  # a flight with a turn takes longer
    assert direct.converged
    assert slow.trajectory.duration > direct.trajectory.duration * (1 + initialisation.SUCCESS)
    runs = {
        1: initialisation.Run(True, 10, direct.trajectory),
        2: initialisation.Run(True, 20, slow.trajectory),
        3: initialisation.Run(False, 30, None),
    }
    monkeypatch.setitem(initialisation.METHODS, "pretend", (lambda _, size: runs[size], 1, (1, 2, 3)))
    found = initialisation_study("horizontal-3", "pretend")
    assert (found["starts"], found["converged"], found["succeeded"]) == (3, 2, 1)
    assert found["iterations"] == 10
    monkeypatch.setitem(initialisation.METHODS, "pretend", (lambda *_: runs[3], 3, (3, 3)))
    found = initialisation_study("horizontal-3", "pretend")
    assert (found["best_s"], found["succeeded"]) == (float("inf"), 0)


def test_the_indirect_method_runs_only_in_free_space():
    asked = runs.row_tasks()
    assert len(asked) == len(set(asked)) == 8 * 5 + 6
    assert {table for table, _ in asked} == set(runs.TABLES)
    assert ("initialisation", ("hoop", "pontryagin")) not in asked


def test_rows_are_computed_in_their_own_processes(monkeypatch):
    monkeypatch.setattr(
        runs, "row_tasks", lambda: [("initialisation", ("horizontal-3", "shooting")), ("verdicts", ("diagonal",))]
    )
    done = []
    found = runs.compute_tables(lambda: done.append(1))
    assert {name: list(table.columns) for name, table in found.items()} == {
        "rows": list(COLUMNS),
        "verdicts": list(VERDICT_COLUMNS),
        "initialisation": list(INITIALISATION_COLUMNS),
    }
    assert found["rows"].empty
    assert found["verdicts"]["scenario"].tolist() == ["diagonal"]
    assert found["initialisation"]["method"].tolist() == ["shooting"]
    assert len(done) == 2


@pytest.fixture
def pretended(row, checked, monkeypatch):
    """All tables at hand, so that the command need not compute them, and one figure of the paper."""
    initialisation_table = dict(
        zip(INITIALISATION_COLUMNS, ("horizontal-3", "shooting", 0.8987, 24, 0.3, 0.02, 5, 5, 4), strict=True)
    )
    at_hand = {"rows": pd.DataFrame([row]), "verdicts": checked, "initialisation": pd.DataFrame([initialisation_table])}
    monkeypatch.setattr(runs, "compute_tables", lambda **_: at_hand)
    monkeypatch.setattr(figures, "FIGURES", {"figure-2": figures.fig2})


@pytest.mark.usefixtures("pretended")
def test_the_command_prints_and_writes_all_tables_and_the_figures(tmp_path):
    out = tmp_path / "paper.json"
    result = CliRunner().invoke(app.app, ["paper", "--json", "--out", str(out)])
    assert result.exit_code == 0
    printed, written = json.loads(result.stdout), json.loads(out.read_text())
    assert printed == {key: written[key] for key in ("rows", "verdicts", "initialisation")}
    assert [row["impossible"] for row in printed["verdicts"]] == [True] * 7 + [None]
    assert {path.name for path in tmp_path.glob("*.html")} == {"figure-2.html", "verdicts.html"}
    readable = " ".join(CliRunner().invoke(app.app, ["paper", "--out", str(out)]).stdout.split())
    assert "Pontryagin" in readable
    assert "optimum found" in readable
    assert "Which printed times are impossible" in readable
    assert "7 of the paper's 7 times are impossible" in readable


@pytest.mark.usefixtures("pretended")
def test_readme_shows_all_tables_and_the_verdict_figure(tmp_path):
    out = tmp_path / "paper.json"
    assert CliRunner().invoke(app.app, ["paper", "--out", str(out)]).exit_code == 0
    results = json.loads(out.read_text())
    text = paper_blocks(results)
    assert "| T*, shooting | indirect | [8] |" in text
    assert "| diagonal | 1.289 | 1.41099 | 1.41128 | 0.020 % | 0.1220 s, 8.65 % |" in text
    assert "published/verdicts.svg)" in text
    assert "| shooting | 1 | 24 | 0.30 | 0.020 | 5 of 5 | 4 of 5 |" in text
    assert max(len(line) for line in text.splitlines() if not line.startswith(("|", "!"))) <= 118
    # Results of an earlier run hold no verdicts.
    del results["verdicts"]
    assert "verdicts.svg" not in paper_blocks(results)
