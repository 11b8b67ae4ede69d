"""The paragraph of provenance names every machine on which the sections of a table ran."""

from experiments.publishing.solvers import measured_by


def test_sections_of_two_machines_have_a_sentence_each():
    cores = {"machine": {"cores": 2}}
    sections = {
        "bounds": cores | {"processor": "A", "date": "2026-01-02T00:00:00"},
        "steps": cores | {"processor": "B", "date": "2026-01-03T00:00:00"},
        "starts": cores | {"processor": "A", "date": "2026-01-04T00:00:00"},
    }
    text = measured_by({"sections": sections}, sections)
    assert " ".join(text.split()) == (
        "`flatquad measure solvers` on 2 cores (A), 2026-01-02 to 2026-01-04. "
        "`flatquad measure solvers` on 2 cores (B), 2026-01-03."
    )


def test_a_section_without_a_machine_has_that_of_the_file():
    results = {"machine": {"cores": 2}, "processor": "A", "sections": {"bounds": {"date": "2026-01-02T00:00:00"}}}
    assert measured_by(results, ("bounds",)) == "`flatquad measure solvers` on 2 cores (A), 2026-01-02."
