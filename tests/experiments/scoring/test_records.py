"""The records: each is verified, and none is worse than the policy that comes with the package."""

import json

import pytest

from experiments.scoring.records import OPTIMAL, RECORDS, refresh, verify_record
from experiments.scoring.score_file import write_content
from flatgym.scenarios.catalogue import SCENARIOS
from flatgym.scenarios.reference import reference

FILES = sorted(RECORDS.glob("*.json"))


def test_the_folder_holds_records_and_their_description():
    assert {path.suffix for path in RECORDS.iterdir()} == {".json", ".md"}
    assert {path.stem for path in FILES} == set(SCENARIOS)
    assert len((RECORDS / "README.md").read_text().splitlines()) <= 15


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_a_record_is_verified(path):
    row = verify_record(path)
    assert row["steps"] >= reference(path.stem).k_star, "faster than K*: correct the table"


def test_records_of_another_table_are_refreshed_and_missing_ones_begin_with_the_flight_of_optimal(tmp_path):
    for path in FILES:
        content = json.loads(path.read_text())
        if path.stem in ("hoop", "split-s"):
            content["table"] = "0" * 64
            content["score"] |= {"k_star": 1, "gap": 9.0}
            content["flights"][0] |= {"k_star": 1, "gap": 9.0}
        if path.stem != "climb":
            write_content(tmp_path / path.name, content)
    refresh(tmp_path)
    for path in FILES:
        one, other = (json.loads((folder / path.name).read_text()) for folder in (RECORDS, tmp_path))
        if path.stem == "climb":
            assert other["policy"] == {"name": OPTIMAL, "fingerprint": None}
            assert verify_record(tmp_path / path.name)["steps"] == reference("climb").k_star
        else:
            changing = {"provenance", "checksum", "score"}
            assert {key: one[key] for key in one.keys() - changing} == {
                key: other[key] for key in other.keys() - changing
            }
            same = one["score"].keys() - {"wall_time_s", "versions"}
            assert {key: one["score"][key] for key in same} == {key: other["score"][key] for key in same}
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    refresh(tmp_path)
    assert before == {path.name: path.read_bytes() for path in tmp_path.iterdir()}


@pytest.mark.parametrize(
    ("name", "change", "reason"),
    [
        ("climb", {}, r"climb.json is of 'hoop'; a record bears the name of its scenario"),
        ("mine", {}, r"mine.json is of 'hoop'"),
        ("hoop", {"score": {"seed": 1_000_007}}, r"must be one successful, undisturbed flight of seed 1000000"),
        ("hoop", {"keywords": {"wind": 1.0}}, r"hoop.json: Refused: its keywords"),
    ],
)
def test_another_file_is_no_record(tmp_path, name, change, reason):
    content = json.loads((RECORDS / "hoop.json").read_text())
    for key, values in change.items():
        content[key] |= values
    write_content(tmp_path / f"{name}.json", content)
    with pytest.raises(ValueError, match=reason):
        verify_record(tmp_path / f"{name}.json")
