"""The tables and figures of the chain bound state what was measured, and say so where nothing was."""

import math

import numpy as np
import pytest

from experiments.files import PUBLISHED
from experiments.publishing import chain
from experiments.publishing.figures import chain as chain_figures
from flatgym import SCENARIOS, Hoop, Scenario
from flatgym.scenarios.reference import reference
from optimal.direct.multistart import search
from optimal.proof.lower_bound import prove_near


def proof_row(scenario, gap, asked, **others):
    row = {"scenario": scenario, "upper_bound_s": 2.0, "lower_bound_s": 1.98999, "gap": gap, "gap_asked": asked}
    return row | {"wall_time_s": 1.5, "evaluations": 1234, "branches": 7, "checked": True} | others


@pytest.fixture
def results():
    """Results with every section of the chain."""
    total = {"tracks": 2, "certified": 2, "checked": 1, "gap_median": 0.00123, "gap_worst": None}
    total |= {"gap_asked": 0.002, "budget_s": 60.0, "wall_time_median_s": 12.34, "scenario": "all"}
    total |= {"wide": 1, "wide_gap": 0.01, "wide_budget_s": 240.0}
    valid = {"certified": 200, "above_a_flight": 0, "slower_excluded": 1}
    sampled = {"draws": 300, "proven": 298, "open_seeds": [1_000_001, 1_000_002], "gap_steps_worst": 1}
    rows = {
        "convergence": [proof_row("hoop", 0.0099, 0.01), proof_row("hoop", 0.0009, 0.001, wall_time_s=3.0)],
        "hoops": [
            proof_row("a", 0.0099, 0.01, hoops=1, processor_time_s=2.5),
            proof_row("b", 0.2, 0.01, hoops=2, wall_time_s=300.0, processor_time_s=400.0),
        ],
        "random_tracks": [total],
        "track_validity": [valid, valid],
        "sampled_steps": [
            sampled | {"distribution": "random-hoops"},
            sampled | {"distribution": "random-track", "draws": 0, "proven": 0, "open_seeds": []},
        ],
    }
    sections = {name: {"rows": each, "date": "2001-02-03T04"} for name, each in rows.items()}
    return {"sections": sections, "machine": {"processor": "p", "system": "s", "cores": 2}}


def words(text):
    """Return a text without its line breaks."""
    return " ".join(text.split())


@pytest.mark.parametrize("table", [chain.convergence, chain.hoops, chain.tracks])
def test_a_section_that_is_not_measured_leaves_the_command_that_measures_it(table, results):
    text = table(results | {"sections": {}})
    assert "Not measured yet. `flatquad measure solvers" in words(text)
    assert "](experiments/" not in text
    assert "Not measured" not in table(results)


def test_tables_have_a_line_for_each_proof_and_a_picture(results):
    assert "| `hoop` | 1.00 % | 0.990 % | 1.50 | 1,234 | 7 |" in chain.convergence(results)
    assert f"published/{chain_figures.CONVERGENCE})" in chain.convergence(results)
    text = chain.hoops(results)
    assert "| 1 | 2.00000 | 1.98999 | 0.990 % | 1.50 | 1,234 | 7 | 2.50 |" in text
    assert "| 2 | 2.00000 | 1.98999 | 20.000 % | 300 |" in text
    assert f"published/{chain_figures.HOOPS})" in text


@pytest.mark.parametrize(("value", "text"), [(0.002443, "0.00244"), (0.5, "0.500"), (61.28, "61.3"), (599.7, "600")])
def test_wall_times_have_three_digits(value, text):
    assert chain.seconds(value) == text


def test_totals_of_tracks_are_stated_and_an_unknown_gap_is_no_number(results):
    text = words(chain.tracks(results))
    assert "Of 2 draws of `random-track`, 2 have a certified flight, and 1 proofs hold when recomputed" in text
    assert "the median gap is 0.12 % at a median of 12.3 s. The 1 draws with" in text
    assert "proven again with 240 s. The largest gap is then unknown." in text
    assert "400 other sampled tracks of 2 to 6 hoops with 2 vehicles, 0 are above" in text
    assert "was excluded 2 times" in text
    assert "K* is proven for 298 of 300 draws of `random-hoops`. The proof spent its time budget" in text
    assert "a gap of 1 step at most for the seeds 1000001, 1000002 of `random-hoops`." in text
    many = {"distribution": "random-track", "draws": 20, "proven": 7, "gap_steps_worst": 2, "open_seeds": [*range(13)]}
    assert chain.sampled_steps([many]).endswith("a gap of 2 steps at most for 13 seeds of `random-track`.")


def test_proven_scenarios_are_counted_from_the_shipped_table(monkeypatch):
    best = {name: reference(name) for name in SCENARIOS}
    text = words(chain.proven())
    for name, each in best.items():
        assert (f"`{name}` ({each.k_star}," in text) == (not each.proven)
    monkeypatch.setattr(chain, "reference", lambda _: best["hoop"])
    assert chain.proven() == f"Yes, for all {len(SCENARIOS)} named scenarios."


def test_only_figures_of_measured_sections_are_drawn(results, monkeypatch, tmp_path):
    class Drawn:
        def to_image(self, _):
            return b"<svg/>"

    for name in ("convergence_figure", "hoops_figure", "explanation"):
        monkeypatch.setattr(chain, name, lambda *_: Drawn())
    chain.draw(tmp_path, results | {"sections": {"hoops": results["sections"]["hoops"]}})
    assert {path.name for path in tmp_path.iterdir()} == {chain_figures.HOOPS, chain_figures.EXPLANATION}


def test_the_explanation_is_published():
    assert (PUBLISHED / chain_figures.EXPLANATION).read_text(encoding="utf-8").startswith("<svg")


def test_every_proof_is_a_point_of_its_figure(results):
    (curve,) = chain_figures.convergence_figure(results["sections"]["convergence"]["rows"]).data
    assert (list(curve.x), list(curve.y)) == ([1.5, 3.0], [0.0099, 0.0009])
    figure = chain_figures.hoops_figure(results["sections"]["hoops"]["rows"])
    lines = {(trace.name, trace.xaxis): trace for trace in figure.data}
    for (name, _), line in lines.items():
        x, y = np.log(line.x), np.log(np.asarray(line.y, dtype=float))
        slopes = [slope for slope, other in chain_figures.REFERENCE_LINES.items() if other == name]
        assert not slopes or np.polyfit(x, y, 1)[0] == pytest.approx(slopes[0])
    proofs = [trace for trace in figure.data if trace.mode == "lines+markers"]
    assert [list(trace.y) for trace in proofs] == [[2.5, 400.0], [1234, 1234]]
    assert all([colour == "white" for colour in trace.marker.color] == [False, True] for trace in proofs)


def test_windows_of_a_proof_shrink_and_leave_no_flight():
    track = Scenario("two", (0.0, 0.0), (5.0, 0.0), hoops=(Hoop(1.5, 0.5, 1.0), Hoop(3.5, -0.5, 1.0)))
    shot = search(track, starts=1).shots[0]
    proof = prove_near(track, shot, max_gap=0.02, time_budget=60.0)
    assert proof.excluded
    for excluded in proof.excluded:
        first, *found = chain_figures.cuts(proof, excluded)
        assert (first.angles, found[-1].windows) == (0, ())
        for before, after in zip([first, *found], found[:-1], strict=False):
            for (low, high), (least, most) in zip(before.windows, after.windows, strict=True):
                assert low <= least < most <= high
    figure = chain_figures.windows_figure(shot, proof, chain_figures.cuts(proof, proof.excluded[0]))
    times = chain_figures.passing_times(shot)
    places = shot.trajectory(times)
    for hoop, place in zip(track.hoops, places, strict=True):
        assert (place - hoop.centre) @ hoop.direction == pytest.approx(0, abs=1e-6)
    assert sum(math.isclose(shape.x0, time) for shape in figure.layout.shapes for time in times) == len(times)
