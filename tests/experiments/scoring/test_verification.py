"""Score files: what was flown replays on any machine, and what was changed is refused with the reason."""

import json
import math
import re
from copy import deepcopy
from dataclasses import replace
from importlib import import_module

import numpy as np
import pytest

import optimal
from agents.controllers.cascaded_pd import CascadedPD
from agents.evaluation.scores import evaluate
from agents.policies.archive import PRETRAINED
from experiments.scoring import claim, score_file, verification
from experiments.scoring.proofs import content_of, verify_proof
from experiments.scoring.score import record, score
from experiments.scoring.score_file import checksum, decode, encode
from experiments.scoring.submission import Submission
from experiments.scoring.verification import MARGIN, Verdict, replayed, same, verify
from experiments.scoring.verify_file import verify_file
from flatgym import DISTRIBUTIONS, SCENARIOS, Disturbances, Quadrotor
from flatgym.scenarios.files import from_dict
from flatgym.scenarios.reference import EVALUATION_SEED, ghost_states, k_star_digest, reference
from optimal.discrete.step_bound import prove_steps
from tests.experiments.cli.shell import flatquad

EPISODES = 5
CASCADE = {"agent": "pd", "episodes": EPISODES}
DISTURBED = {"wind": 0.5, "mass": 0.05, "action_delay": 2, "sensor_noise": 0.01}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("scores")


def written(folder, name, **fields):
    """Write a score file and return its path; K* that has to be computed is kept in the folder."""
    path = folder / f"{name}.json"
    submission = Submission(**fields)
    record(submission, score(submission, folder, 60.0, check=False), path, "flatquad evaluate")
    return path


@pytest.fixture(scope="module")
def goals(folder):
    return written(folder, "goals", scenario="random-goal", **CASCADE)


@pytest.fixture(scope="module")
def hoop(folder):
    return written(folder, "hoop", pretrained="hoop", episodes=1)


@pytest.fixture(scope="module")
def content(goals):
    return json.loads(goals.read_text())


def signed(content):
    """Return a content with the checksum that belongs to it, as a forger would write it."""
    return content | {"checksum": checksum(content)}


def changed(content, *path_and_value):
    """Return a content with another value at a path, and its checksum."""
    *path, last, value = path_and_value
    new = deepcopy(content)
    place = new
    for key in path:
        place = place[key]
    place[last] = value(place[last]) if callable(value) else value
    return signed(new)


def test_a_recorded_score_is_verified_and_recomputed(content):
    found = verify(content)
    assert found.verdict is Verdict.VERIFIED
    assert found.score["episodes"] == EPISODES
    for key in ("success_rate", "success_low", "steps", "k_star", "gap", "gap_low", "gap_high", "outcomes"):
        assert same(content["score"][key], found.score[key])
    assert found.score["gap"] > 0


@pytest.mark.parametrize(
    ("name", "fields"),
    [
        ("disturbed", CASCADE | {"scenario": "random-hoops", "wind": 1}),
        ("ground", CASCADE | {"scenario": "ground-6", "episodes": 1}),
        ("failing", {"pretrained": "climb", "scenario": "drop", "episodes": 2}),
    ],
)
def test_disturbed_and_failed_flights_are_verified(folder, name, fields):
    if fields.pop("wind", 0):
        fields = fields | {"disturbances": Disturbances(**DISTURBED)}
    found = verify(json.loads(written(folder, name, **fields).read_text()))
    assert found.verdict is Verdict.VERIFIED, found.reason
    if name == "failing":
        assert (found.score["success_rate"], found.score["gap"]) == (0.0, None)


def test_recording_does_not_change_the_score(goals):
    (row,) = evaluate(CascadedPD(Quadrotor()), "random-goal", EPISODES).to_dict("records")
    recorded = json.loads(goals.read_text())["score"]
    assert {key: recorded[key] for key in ("steps", "gap", "success_rate", "k_star")} == {
        key: row[key] for key in ("steps", "gap", "success_rate", "k_star")
    }


def test_a_file_of_another_machine_and_version_is_verified(content):
    other = content["provenance"] | {
        "machine": {"processor": "riscv64", "system": "Haiku", "cores": 4096},
        "processor": "unknown",
        "commit": "0" * 40,
        "date": "2031-01-01T00:00:00+00:00",
        "versions": {"python": "3.19.0", "flatgym": "9.9.9", "numpy": "5.0"},
        "something new": [1, 2],
    }
    assert verify(changed(content, "provenance", other)).verdict is Verdict.VERIFIED


def bent(text):
    """Return the actions of a flight, changed by little but all along."""
    actions = decode(text).copy()
    actions[:, 1] = np.clip(actions[:, 1] + 0.03, -1, 1)
    return encode(actions)


def tolerant(problem):
    return problem | {"tolerance": problem["tolerance"] | {"position": 0.2}}


TAMPERED = {
    "action": (("flights", 2, "actions", bent), r"flight 2 \(seed 1000002\) is claimed to end with 'goal'"),
    "seed": (("score", "seed", EVALUATION_SEED + 1), r"claimed to end with 'goal' .*; so do \d others"),
    "scenario": (("problem", "half_width", 2.0), r"its 'random-goal' is not that of this version: half_width: 2.0"),
    "tolerance": (("problem", tolerant), r"is not that of this version: tolerance.position: 0.2, here 0.1"),
    "version": (("environment", "FlatQuad-v1"), r"it is of 'FlatQuad-v1', this version flies FlatQuad-v0"),
    "steps": (("flights", 0, "steps", lambda steps: steps - 1), r"flight 0 .* claims \d+ steps, has \d+ actions"),
    "policy hash": (("policy", "fingerprint", "abc"), r"fingerprint of its policy is not 64 hexadecimal digits: 'abc'"),
    "kwargs": (("keywords", "wind", 1.0), r"its keywords \{'wind': 1.0\} are not the disturbances of its score"),
    "K*": (("flights", 1, "k_star", lambda k_star: k_star + 3), r"K\* of flight 1 .* is \d+ here, and \d+"),
    # neighbours
    "another policy": (("policy", "fingerprint", "0" * 64), r"its score is of the policy \w+, and it names 0+"),
    "gap": (("flights", 3, "gap", 0.0), r"the gap of flight 3 .* is 0\.\d+, and 0.0 is claimed"),
    "score": (("score", "success_rate", 0.9), r"the success_rate of its flights is 1.0, and 0.9 is claimed"),
    "interval": (("score", "gap_high", 0.0), r"the gap_high of its flights is 0\.\d+, and 0.0 is claimed"),
    "outcome": (("flights", 0, "outcome", "floor"), r"claimed to end with 'floor' .* ends with 'goal' after"),
    "no outcome": (("flights", 0, "outcome", "landed"), r"the outcome 'landed', which is none of goal, collision"),
    "last action": (
        ("flights", 0, "actions", lambda text: text[:-16]),
        r"its actions are \d+ bytes, not pairs of",
    ),
    "half an action": (("flights", 0, "actions", lambda _: "AAAA"), r"its actions are 3 bytes, not pairs of float32"),
    "no number": (("flights", 0, "actions", encode(np.full((60, 2), np.nan))), r"do not lie in \[-1, 1\]"),
    "strong": (("flights", 0, "actions", encode(np.full((60, 2), 1.1))), r"do not lie in \[-1, 1\]"),
    "no text": (("flights", 0, "actions", [1, 2]), r"its actions are not base64"),
    "flight": (("flights", 0, "goal"), r"flight 0 .* lacks outcome, steps, k_star, gap or actions"),
    "K* as text": (("flights", 0, "k_star", "70"), r"k_star must be a number or null, got '70'"),
    "fewer flights": (("flights", lambda flights: flights[1:]), r"is of 5 episodes, and it holds 4 flights"),
    "no flights": (("flights", []), r"is of 5 episodes, and it holds 0 flights"),
    "schema": (("schema", 2), r"it has schema 2, this version reads 1"),
    "kind": (("kind", "score"), r"its kind is 'score', not 'flatquad-score'"),
    "digest": (("digest", "0" * 64), r"the digest of its 'random-goal' is not that of the content"),
    "table": (("table", "0" * 64), r"its table of K\* is not ours .*K\* of its own flights agree, others do not"),
    "unknown keyword": (("keywords", lambda words: words | {"rain": 1}), r"its keywords are wind, .*rain, not wind"),
    "strange keyword": (("keywords", "mass", 2.0), r"its keywords are not valid: Disturbances.mass must be below 1"),
    "first seed": (("score", "seed", -1), r"its seed is -1, not a whole number"),
    "problem": (("problem", "dt", "fast"), r"its problem is not valid: .*dt must be a number"),
    "another kind": (("problem", "kind", "world"), r"its problem is not valid: unknown kind 'world'"),
    "part": (("provenance", None), r"it lacks 'provenance', or holds it in another form"),
    "proven": (("score", "proven", True), None),
}


@pytest.mark.parametrize("name", TAMPERED)
def test_a_tampered_file_is_refused_with_the_reason(content, name):
    change, reason = TAMPERED[name]
    found = verify(changed(content, *change))
    if reason is None:  # all K* of these flights are proven: the claim is true
        assert found.verdict is Verdict.VERIFIED
        return
    assert found.verdict is Verdict.REFUSED
    assert found.score == {}
    assert re.search(reason, found.reason), found.reason


def test_a_change_without_a_new_checksum_is_told_even_where_nothing_else_is_wrong(content):
    found = verify(content | {"provenance": content["provenance"] | {"date": "yesterday"}})
    assert (found.verdict, "checksum" in found.reason) == (Verdict.REFUSED, True)
    deeper = verify(content | {"environment": "FlatQuad-v1"})
    assert "FlatQuad-v1" in deeper.reason
    assert deeper.reason.endswith("; the checksum does not match the content either.")


@pytest.mark.parametrize("share", [0.0, 0.3, 0.99])
def test_a_truncated_file_is_refused(goals, tmp_path, share):
    text = goals.read_text()
    path = tmp_path / "cut.json"
    path.write_text(text[: int(share * len(text))])
    row = verify_file(path, None)
    assert row["verdict"] == "refused"
    assert "it is damaged or cut short" in row["reason"]


def test_a_json_that_is_no_object_is_refused(tmp_path):
    path = tmp_path / "list.json"
    path.write_text("[1, 2]")
    assert "neither a score file nor a proof" in verify_file(path, None)["reason"]


def edge(content, short):
    """Return the score file of the K* flight in a hoop scenario whose position tolerance ends beside its last state."""
    known, named = reference("hoop"), SCENARIOS["hoop"].to_dict()
    away = float(math.hypot(*(ghost_states("hoop")[-1][:2] - 5.0)))
    problem = named | {"name": "edge", "tolerance": named["tolerance"] | {"position": away + short}}
    flight = {"outcome": "goal", "steps": 70, "k_star": 70, "gap": 0.0, "actions": encode(known.actions)}
    score = content["score"] | {"scenario": "edge", "episodes": 1}
    parts = {"problem": problem, "flights": [flight], "score": score, "digest": None, "table": None}
    new = content | parts
    new["digest"] = from_dict(problem).digest
    return signed(new)


def test_a_flight_that_depends_on_rounding_is_fragile(content):
    found = claim.read(edge(content, MARGIN / 4))
    assert "flight 0 (seed 1000000), replayed with limits 1e-09 tighter (NumPy), has not ended" in replayed(found)
    assert replayed(claim.read(edge(content, 4 * MARGIN))) == ""
    with pytest.raises(claim.Refused, match="claimed to end with 'goal' after 70 steps"):
        replayed(claim.read(edge(content, -4 * MARGIN)))


def test_disagreeing_implementations_are_fragile(content, monkeypatch):
    true = verification.replay

    def wrong(*arguments, implementation, **keywords):
        found = true(*arguments, implementation=implementation, **keywords)
        return found if implementation == "NumPy" else type(found)(found.outcomes, found.steps + 1)

    monkeypatch.setattr(verification, "replay", wrong)
    found = verify(content)
    assert found.verdict is Verdict.FRAGILE
    assert "replayed exactly (compiled)" in found.reason


def test_fewer_steps_than_k_star_are_verified_and_told(hoop, monkeypatch):
    table, optima = import_module("flatgym.scenarios.reference"), import_module("agents.evaluation.optima")
    content = json.loads(hoop.read_text())
    worse = table.reference("hoop").__class__(**vars(table.reference("hoop")) | {"k_star": 73})
    for module in (table, optima):
        monkeypatch.setattr(module, "reference", lambda _: worse)
    flight = content["flights"][0] | {"k_star": 73, "gap": 70 / 73 - 1}
    score = content["score"] | {"k_star": 73} | dict.fromkeys(("gap", "gap_low", "gap_high"), 70 / 73 - 1)
    found = verify(signed(content | {"flights": [flight], "score": score, "table": k_star_digest("hoop")}))
    assert found.verdict is Verdict.VERIFIED
    assert "fewer steps than K*" in found.reason


def test_k_star_of_an_own_scenario_is_computed_where_it_is_claimed(folder):
    own = replace(SCENARIOS["horizontal-3"], name="own", goal=(3.5, 0.0)).to_json()
    known = json.loads(written(folder, "own", scenario=own, agent="pd", episodes=1).read_text())
    (flight,) = known["flights"]
    assert (known["table"], flight["outcome"]) == (None, "goal")
    assert reference("horizontal-3").k_star < flight["k_star"] < flight["steps"]
    assert verify(known, folder).verdict is Verdict.VERIFIED
    found = verify(changed(known, "flights", 0, "k_star", flight["k_star"] + 2), folder)
    assert f"K* of flight 0 (seed {EVALUATION_SEED}) is {flight['k_star']:g} here, and " in found.reason
    unknown = dict.fromkeys(("k_star", "gap", "gap_low", "gap_high"))
    parts = {"flights": [flight | {"k_star": None, "gap": None}], "score": known["score"] | unknown | {"proven": False}}
    found = verify(signed(known | parts), folder)
    assert (found.verdict, found.score["k_star"], found.score["gap"]) == (Verdict.VERIFIED, None, None), found.reason


def test_actions_keep_every_bit():
    actions = np.random.default_rng(0).uniform(-1, 1, (1000, 2)).astype(np.float32)
    assert np.array_equal(decode(encode(actions)), actions)
    assert len(encode(actions)) < 11 * len(actions)


def test_the_digest_of_k_star_belongs_to_the_problem():
    assert all(k_star_digest(name) for name in (*SCENARIOS, *DISTRIBUTIONS))
    assert k_star_digest("horizontal-6") == k_star_digest("ground-6")  # both 61
    assert k_star_digest(replace(DISTRIBUTIONS["random-track"], hoops=(4, 7))) is None
    assert k_star_digest(replace(SCENARIOS["hoop"], dt=0.01)) is None


def command(monkeypatch, capsys, *arguments):
    status, out, err = flatquad(monkeypatch, capsys, "verify", *map(str, arguments), "--json")
    return status, (json.loads(out)[0] if out else None), err


def test_the_policy_is_compared_by_file_and_by_flight(monkeypatch, capsys, hoop):
    zipped = PRETRAINED / "hoop.zip"
    status, row, _ = command(monkeypatch, capsys, hoop, "--policy", zipped)
    assert (status, row["verdict"]) == (0, "verified")
    assert row["reason"].endswith("hoop.zip flies the same actions.")
    status, row, _ = command(monkeypatch, capsys, hoop, "--policy", PRETRAINED / "climb.zip")
    assert (status, row["verdict"]) == (2, "refused")
    assert "fingerprint" in row["reason"]
    claimed = claim.read(json.loads(hoop.read_text()))
    (actions,) = (flight.actions for flight in claimed.flights)
    verification.check_actions(claimed, "mine", [actions + np.float32(5e-5)])  # rounding of another machine
    for other in (actions[:-1], actions + np.float32(2e-4), -actions):
        with pytest.raises(
            claim.Refused, match=r"mine flies flight 0 \(seed 1000000\) with other actions than recorded"
        ):
            verification.check_actions(claimed, "mine", [other])


def test_the_exit_status_tells_the_verdict(monkeypatch, capsys, goals, tmp_path, content):
    assert command(monkeypatch, capsys, goals)[0] == 0
    path = tmp_path / "tampered.json"
    score_file.write_content(path, changed(content, "environment", "CartPole-v1"))
    status, row, _ = command(monkeypatch, capsys, path)
    assert (status, row["verdict"]) == (2, "refused")
    status, _, err = command(monkeypatch, capsys, tmp_path / "none.json")
    assert status == 1
    assert "none.json" in err


@pytest.fixture(scope="module")
def proof():
    return optimal.prove("hoop", max_gap=0.01)


def test_a_proof_is_verified_by_the_second_checker(monkeypatch, capsys, proof, tmp_path):
    path = proof.save(tmp_path / "proof.json")
    status, row, _ = command(monkeypatch, capsys, path)
    assert (status, row["verdict"], row["checker"]) == (0, "verified", "second checker")
    assert (row["scenario"], row["content"], row["steps"]) == ("hoop", "as in this version", None)
    assert row["time_s"] == proof.time
    assert row["reason"] == f"Verified: no flight takes less than {proof.time:.6g} s."


def test_a_false_proof_and_a_damaged_one_are_refused(monkeypatch, capsys, proof, tmp_path):
    path = replace(proof, time=proof.flown * 1.01).save(tmp_path / "proof.json")
    status, row, _ = command(monkeypatch, capsys, path)
    assert (status, row["reason"]) == (2, "Refused: the second checker does not confirm it.")
    path.write_text('{"schema": 2, "proof": {}}')
    status, row, _ = command(monkeypatch, capsys, path)
    assert status == 2
    assert row["reason"].startswith("Refused: it is not a proof")
    path.write_text(proof.save(path).read_text()[:-9])
    assert command(monkeypatch, capsys, path)[0] == 2


def test_a_proof_too_large_for_the_second_checker_names_the_other_one(proof, tmp_path, monkeypatch):
    monkeypatch.setattr(import_module("optimal.proof.independent.checker"), "MOST_WORK", 0.0)
    row = verify_proof(proof.save(tmp_path / "proof.json"))
    assert (row["verdict"], row["checker"]) == ("verified", "prover's own check")
    assert row["reason"].endswith(
        "The second checker did not decide it: its windows are too wide, or its grids too fine."
    )


def test_a_proof_of_steps_is_of_the_relaxed_scenario(tmp_path):
    scenario = SCENARIOS["horizontal-3"]
    shot = import_module("optimal.direct.multistart").search(scenario).shots[0]
    row = verify_proof(prove_steps(scenario, shot, 44).save(tmp_path / "proof.json"))
    assert (row["verdict"], row["steps"]) == ("verified", 43)
    assert row["content"] == "as in this version, relaxed by rounding"
    assert row["reason"] == "Verified: no flight takes 43 steps or fewer."
    assert content_of(replace(scenario, dt=0.01)) == content_of(replace(scenario, name="mine")) == "its own"
