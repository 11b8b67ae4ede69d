"""The table and the sheets of the scenarios show all of them, with the best-known flights."""

from xml.etree import ElementTree

import numpy as np
import pytest

from experiments.files import PUBLISHED
from experiments.publishing.scenarios import (
    CAPTION,
    HEIGHTS,
    HOOP,
    PANELS,
    TILE,
    scenario_and_flight,
    sheet,
    table,
    tracks,
)
from flatgym import SCENARIOS
from flatgym.scenarios.reference import reference

SVG = "{http://www.w3.org/2000/svg}"


def test_the_table_has_a_row_for_each_scenario_with_its_best_known_steps():
    rows = table().splitlines()[2:]
    assert len(rows) == len(SCENARIOS)
    for row, name in zip(rows, SCENARIOS, strict=True):
        assert row.startswith(f"| `{name}` |")
        assert f"| {reference(name).k_star}" in row


def boxes():
    """The width and height of every picture of the sheet of tracks, by name."""
    return {name: (wide, tall) for row, tall in zip(PANELS, HEIGHTS, strict=True) for name, wide in row}


@pytest.mark.parametrize("drawn", [sheet, tracks])
def test_every_picture_shows_its_scenario_and_flight_and_nothing_leaves_it(drawn):
    pictures = ElementTree.fromstring(drawn()).findall(f"{SVG}g")
    assert len({picture.get("transform") for picture in pictures}) == len(pictures)
    for picture in pictures:
        name = picture.find(f"{SVG}text").text
        scenario, states = scenario_and_flight(name)
        path = picture.find(f"{SVG}polyline").get("points").split()
        points = [tuple(map(float, point.split(","))) for point in path]
        assert len(points) == (len(states) if name in SCENARIOS else len(scenario.hoops) + 2)
        lines = picture.findall(f"{SVG}line")
        assert [line.get("stroke") for line in lines].count(HOOP) == len(scenario.hoops)
        points += [(float(line.get(f"x{i}")), float(line.get(f"y{i}"))) for line in lines for i in (1, 2)]
        x, y = np.array(points).T
        wide, tall = boxes().get(name, (TILE, TILE))
        assert 0 <= x.min() <= x.max() <= wide
        assert CAPTION <= y.min() <= y.max() <= tall + CAPTION


def test_the_sheets_show_every_named_scenario_once_and_sampled_tracks():
    names = [text.text for drawn in (sheet, tracks) for text in ElementTree.fromstring(drawn()).iter(f"{SVG}text")]
    named = [name for name in names if name in SCENARIOS]
    assert sorted(named) == sorted(SCENARIOS)
    others = [name for name in names if name not in SCENARIOS]
    assert others
    assert all(name.startswith("random-track-") for name in others)


@pytest.mark.parametrize(("name", "drawn"), [("scenarios", sheet), ("tracks", tracks)])
def test_the_published_sheets_are_the_present_ones(name, drawn):
    assert (PUBLISHED / f"{name}.svg").read_text(encoding="utf-8") == drawn()
