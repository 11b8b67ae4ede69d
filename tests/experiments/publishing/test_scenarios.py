"""The table and the sheet of the scenarios show all of them, with the best-known flights."""

from xml.etree import ElementTree

import numpy as np

from experiments.files import PUBLISHED
from experiments.publishing.scenarios import COLUMNS, TILE, sheet, table
from flatgym import SCENARIOS
from flatgym.scenarios.reference import reference

SVG = "{http://www.w3.org/2000/svg}"


def test_the_table_has_a_row_for_each_scenario_with_its_best_known_steps():
    rows = table().splitlines()[2:]
    assert len(rows) == len(SCENARIOS)
    for row, name in zip(rows, SCENARIOS, strict=True):
        assert row.startswith(f"| `{name}` |")
        assert f"| {reference(name).k_star}" in row


def test_the_sheet_has_a_tile_for_each_scenario_and_nothing_leaves_its_tile():
    tiles = ElementTree.fromstring(sheet()).findall(f"{SVG}g")
    assert [tile.find(f"{SVG}text").text for tile in tiles] == list(SCENARIOS)
    assert len({tile.get("transform") for tile in tiles}) == len(SCENARIOS)
    for tile, (name, scenario) in zip(tiles, SCENARIOS.items(), strict=True):
        points = np.array(
            [point.split(",") for point in tile.find(f"{SVG}polyline").get("points").split()], dtype=float
        )
        assert len(points) == reference(name).k_star + 1
        assert points.min() >= 0
        assert points[:, 0].max() <= TILE
        colours = [line.get("stroke") for line in tile.findall(f"{SVG}line")]
        assert colours.count("#d1495b") == len(scenario.hoops)
    assert COLUMNS * TILE < 1000


def test_the_published_sheet_is_the_present_one():
    assert (PUBLISHED / "scenarios.svg").read_text(encoding="utf-8") == sheet()
