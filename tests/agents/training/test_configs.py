"""Configurations: JSON round trip, and errors that name the field."""

import json
from dataclasses import fields, replace

import pytest

from agents.training.configs import CONFIGS, PPOConfig, SACConfig, config_of, from_json

ALGORITHMS = tuple(CONFIGS)


@pytest.mark.parametrize("algorithm", ALGORITHMS)
def test_json_round_trip(algorithm):
    config = config_of(
        algorithm, scenario="random-goal", seed=3, learning_rate=1e-4, tensorboard="runs", value_width=128
    )
    assert from_json(config.to_json()) == config
    assert json.loads(config.to_json())["algorithm"] == algorithm


def test_missing_fields_take_their_defaults():
    assert from_json('{"algorithm": "sac", "seed": 2}') == SACConfig(seed=2)


def test_whole_numbers_are_stored_as_floats_in_float_fields():
    config = PPOConfig(tolerance=2)
    assert isinstance(config.tolerance, float)
    assert config == PPOConfig(tolerance=2.0)


@pytest.mark.parametrize(
    ("field", "value", "words"),
    [
        ("scenario", "hop", "did you mean 'hoop'"),
        ("scenario", 3, "must be a str"),
        ("seed", -1, "whole number in 0"),
        ("seed", 2**32, "whole number in 0..4294967295"),
        ("seed", 1.5, "whole number"),
        ("max_seconds", 0.0, "must be positive"),
        ("max_seconds", float("nan"), "must be finite"),
        ("env_steps", 0, "whole number in 1"),
        ("num_envs", True, "whole number"),
        ("width", 0, "whole number in 1"),
        ("learning_rate", -1e-3, "must be positive"),
        ("gamma", 1.01, "must lie in 0..1"),
        ("pool_share", -0.1, "must lie in 0..1"),
        ("pool_expert_share", "much", "must be a number"),
        ("tolerance", 0.5, "must lie in 1.."),
        ("failure_cost", -1.0, "at least 0"),
        ("guidance", 1, "must be a bool"),
        ("turns", 0.5, "whole number in -100..100"),
        ("tensorboard", True, "must be a str"),
        ("policy", None, "must be a str"),
        ("log_std_init", float("inf"), "must be finite"),
    ],
)
def test_invalid_values_are_named(field, value, words):
    with pytest.raises(ValueError, match=words) as error:
        replace(PPOConfig(), **{field: value})
    assert repr(value) in str(error.value)
    assert f"PPOConfig.{field}" in str(error.value) or field == "scenario"


def test_every_field_of_every_algorithm_checks_its_type():
    for kind in CONFIGS.values():
        for field in fields(kind):
            with pytest.raises(ValueError, match=rf"{kind.__name__}\.{field.name} must be"):
                kind(**{field.name: object()})


def test_unknown_fields_are_named_with_the_known_ones():
    with pytest.raises(ValueError, match=r"unknown fields gae_lambda, n_epochs of SACConfig; known: scenario, seed"):
        config_of("sac", n_epochs=3, gae_lambda=0.9)


@pytest.mark.parametrize("text", ["", "[]", "3", "{}", '{"algorithm": 3}', '{"algorithm": "PPO"'])
def test_text_that_is_no_configuration_is_refused(text):
    with pytest.raises(ValueError, match="a configuration must be"):
        from_json(text)


def test_an_unknown_algorithm_is_refused():
    with pytest.raises(ValueError, match="unknown algorithm 'a3c'; known: PPO, SAC, TD3, TQC"):
        config_of("a3c")
