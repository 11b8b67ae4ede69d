"""The records: each is verified, and none is worse than the policy that comes with the package."""

import json

import pytest

from experiments.scoring.records import RECORDS, verify_record
from experiments.scoring.score_file import write_content
from flatgym.scenarios.reference import reference

FILES = sorted(RECORDS.glob("*.json"))


def test_the_folder_holds_records_and_their_description():
    assert {path.suffix for path in RECORDS.iterdir()} == {".json", ".md"}
    assert len(FILES) >= 10
    assert len((RECORDS / "README.md").read_text().splitlines()) <= 15


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_a_record_is_verified(path):
    row = verify_record(path)
    assert row["steps"] >= reference(path.stem).k_star, "faster than K*: correct the table"


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
