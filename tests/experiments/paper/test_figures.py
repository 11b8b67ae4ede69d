"""The paper's figures hold what they say: paths between outer paths, flights, limits."""

import numpy as np
import pytest

from experiments.paper import figures
from flatgym import SCENARIOS
from optimal import solve
from optimal.paths.corridors import paper_corridor


@pytest.fixture
def quick(monkeypatch):
    """Every case flown by the shooting with winding 0 only, which is quick."""
    monkeypatch.setattr(figures, "solved", lambda name, _: solve(name, windings=(0,), starts=1))


def traces(figure, name):
    return [trace for trace in figure.data if trace.name == name]


def test_figure_2_combines_its_outer_paths_and_clears_the_walls():
    figure = figures.fig2()
    upper, lower, middle = (
        np.array([trace.x, trace.y]) for i in "12r" for trace in traces(figure, f"y<sub>{i}</sub>(s)")
    )
    share = np.sqrt(np.linspace(0, 1, upper.shape[1]))
    np.testing.assert_allclose(middle, (1 - share) * upper + share * lower, atol=1e-12)
    above, below = (np.array(wall).T for wall in figures.WALLS)
    for line in (upper, middle, lower):
        assert (line[1] < np.interp(line[0], above[0, 1:-1], above[1, 1:-1])).all()
        assert (line[1] > np.interp(line[0], below[0, 1:-1], below[1, 1:-1])).all()


@pytest.mark.usefixtures("quick")
def test_figure_3_has_the_ground_in_its_lower_panel_only():
    figure = figures.fig3()
    assert [note.text.split(",")[0] for note in figure.layout.annotations] == ["in free space", "above the ground"]
    floors = [shape for shape in figure.layout.shapes if shape.y0 == shape.y1 == 0]
    assert [shape.yref for shape in floors] == ["y2"]
    assert figure.layout.yaxis.scaleanchor == "x"


@pytest.mark.usefixtures("quick")
def test_figures_4_and_5_end_at_the_goal_and_5_stays_between_its_outer_paths():
    for figure in (figures.fig4(), figures.fig5()):
        flight = next(trace for trace in figure.data if trace.name.startswith("T = "))
        np.testing.assert_allclose((flight.x[-1], flight.y[-1]), (5, 5), atol=1e-9)
        assert figure.layout.xaxis.range == pytest.approx(figure.layout.yaxis.range)
    drawn = traces(figure, "outer path")
    for line, path in zip(drawn, paper_corridor(SCENARIOS["hoop"]).paths, strict=True):
        np.testing.assert_allclose((line.x[200], line.y[200]), path(0.5), atol=1e-12)
    assert figure.data[0].name == "corridor"  # under everything else


@pytest.mark.usefixtures("quick")
def test_figure_6_compares_two_methods_within_the_limits():
    figure = figures.fig6()
    assert {trace.name.split(",")[0] for trace in figure.data} == {"flat", "shooting"}
    assert {shape.y0 for shape in figure.layout.shapes} == {1.0, 20.0, -10.0, 10.0}


def test_the_flat_flight_is_drawn_from_rest_to_rest():
    track = figures.track("horizontal-6", words="flat, ")
    assert track.name.startswith("flat, T = 1.23")
    np.testing.assert_allclose(track.state[[0, -1]], [[0] * 5, [6, 0, 0, 0, 0]], atol=1e-8)


@pytest.fixture(scope="module")
def verdicts():
    """A time that is impossible, one that is not, and a case without one."""
    rows = [
        ("horizontal-3", 0.8902, 0.8985, 0.8987, True),
        ("diagonal", 1.289, 1.2, 1.41, False),
        ("hoop", None, 1.4113, 1.4116, None),
    ]
    keys = ("scenario", "printed_s", "lower_bound_s", "upper_bound_s", "impossible")
    return [
        {
            **dict(zip(keys, row, strict=True)),
            "gap": row[3] / row[2] - 1,
            "shortfall_s": row[2] - row[1] if row[4] else None,
            "shortfall": 1 - row[1] / row[2] if row[4] else None,
        }
        for row in rows
    ]


def test_times_lie_in_percent_of_the_bound_on_their_side_of_it(verdicts):
    figure = figures.verdict_figure(verdicts)
    (printed,), (certified,) = traces(figure, "printed"), traces(figure, "T* upper bound")
    times = np.array([(row["printed_s"] or np.nan, row["upper_bound_s"]) for row in verdicts])
    bounds = np.array([row["lower_bound_s"] for row in verdicts])
    np.testing.assert_allclose(bounds * (1 + np.array(printed.x) / 100), times[:, 0])
    np.testing.assert_allclose(bounds * (1 + np.array(certified.x) / 100), times[:, 1])
    assert (np.array(certified.x) >= 0).all()
    (shade,) = figure.layout.shapes  # all that is impossible, and nothing else
    assert (shade.x0, shade.x1) == (figure.layout.xaxis.range[0], 0)
    low, high = figure.layout.xaxis.range
    assert all(low < x < high for x in (*certified.x, *printed.x) if np.isfinite(x))


def test_labels_say_each_time_once_and_each_distance(verdicts):
    notes = [note.text for note in figures.verdict_figure(verdicts).layout.annotations]
    for row in verdicts:
        assert notes.count(row["scenario"]) == notes.count(f"{row['upper_bound_s']:.5f}") == 1
    assert {"\N{MINUS SIGN}0.92 %", "+0.02 %", "+7.42 %", "+17.50 %"} <= set(notes)
    assert not any("nan" in note for note in notes)


@pytest.mark.usefixtures("quick")
def test_all_figures_are_written(tmp_path, verdicts):
    done = []
    pages = figures.pages(verdicts)
    figures.write_pages(pages, tmp_path, lambda: done.append(1))
    assert {path.name for path in tmp_path.iterdir()} == {f"{name}.html" for name in pages}
    assert set(pages) == {*(f"figure-{i}" for i in range(2, 7)), "verdicts"}
    assert len(done) == 6
