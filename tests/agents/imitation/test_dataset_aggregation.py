"""DAgger: stops at the target and returns the best round."""

from dataclasses import replace

import numpy as np

from agents.evaluation.rollouts import fly
from agents.imitation.cloning import untrained_policy
from agents.imitation.dataset import ExpertData
from agents.imitation.dataset_aggregation import DaggerConfig, dagger
from agents.imitation.oracles import lqr_oracle
from agents.imitation.selection import BestPolicy


def test_dagger_returns_the_best_round_and_stops_at_the_target(flight):
    config = DaggerConfig(scenario="horizontal-3", width=64, gradient_steps=400, rounds=3, batch_size=256)
    points = []
    best = BestPolicy(config, target=flight.steps, on_validation=points.append)
    model = dagger(untrained_policy(config), lqr_oracle([flight], count=8), config, best)
    assert points == best.curve
    assert 1 <= len(points) <= 3
    assert best.env_steps > 0 or len(points) == 1
    first = max(points, key=lambda point: (point["success_rate"], -point["steps"]))
    flown = fly(model, "horizontal-3")
    assert (flown.steps[0], flown.outcomes[0]) == (first["steps"], first["outcome"])
    easy = BestPolicy(config, target=1000)
    dagger(
        untrained_policy(config),
        lambda *_: ExpertData(*map(np.asarray, lqr_oracle([flight])(None, 0))),
        replace(config, rounds=2),
        easy,
    )
    assert len(easy.curve) in (1, 2)
