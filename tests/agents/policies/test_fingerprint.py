"""Fingerprints: the digest of the file that defines a policy, by every way to name it."""

import hashlib
from pathlib import Path

import pytest

from agents.controllers import cascaded_pd
from agents.policies.archive import PRETRAINED
from agents.policies.fingerprint import fingerprint, is_fingerprint


def digest(path):
    return hashlib.sha256(Path(path).read_bytes()).hexdigest()


def test_a_file_a_module_and_a_script_have_the_digest_of_their_file(tmp_path, monkeypatch):
    zipped, module = PRETRAINED / "hoop.zip", "agents.controllers.cascaded_pd:CascadedPD"
    assert fingerprint(zipped) == fingerprint(str(zipped)) == digest(zipped)
    assert fingerprint(module) == digest(cascaded_pd.__file__)
    (tmp_path / "mine.py").write_text("def policy(observations): raise SystemExit\n")
    monkeypatch.chdir(tmp_path)
    assert fingerprint("mine.py:policy") == fingerprint("mine:policy") == digest(tmp_path / "mine.py")


def test_another_content_has_another_fingerprint(tmp_path):
    path = tmp_path / "mine.py"
    path.write_text("policy = 1\n")
    before = fingerprint(path)
    path.write_text("policy = 2\n")
    assert fingerprint(path) != before
    assert is_fingerprint(before)


@pytest.mark.parametrize(
    ("source", "message"),
    [
        ("no-such.zip", "neither a file nor of the form module:object"),
        ("no_such_module:policy", "'no_such_module' of the policy .* has no source file"),
        ("no.such.module:policy", "has no source file"),
        ("no-such.py:policy", "there is no file 'no-such.py'"),
        ("sys:exit", "has no source file"),
        ("", "neither a file"),
    ],
)
def test_a_policy_without_a_file_is_named(source, message):
    with pytest.raises(ValueError, match=message):
        fingerprint(source)


def test_statistics_are_part_of_the_fingerprint(tmp_path):
    policy, one, other = (tmp_path / name for name in ("policy.zip", "one.pkl", "other.pkl"))
    for path in (policy, one, other):
        path.write_text(path.name)
    prints = {fingerprint(policy), fingerprint(policy, one), fingerprint(policy, other), fingerprint(one, policy)}
    assert len(prints) == 4
    assert all(map(is_fingerprint, prints))
    other.write_text(one.name)
    assert fingerprint(policy, other) == fingerprint(policy, one)


@pytest.mark.parametrize("text", [None, 3, "", "0" * 63, "g" * 64, "A" * 64, "0" * 65, "0" * 64 + "\n"])
def test_only_64_lower_case_digits_are_a_fingerprint(text):
    assert not is_fingerprint(text)
