"""A categorical actor: an ordinary Stable-Baselines3 policy whose actions are bins of the action box.

    PPO(CategoricalPolicy, make_vec_env("hoop"), policy_kwargs={"bins": (3, 21)})

Time-optimal thrust is always at a limit and the rate mostly is, and beside a rim two very different actions can be
equally good. A Gaussian holds neither: its samples miss the limits, and its mean lies between the two. Here each
action is one of evenly spaced levels, which hold both limits and, for an odd number, zero. Thrust and rate are
independent given the observation (Tang and Agrawal, Discretizing Continuous Action Space for On-Policy Optimization,
2020). Actions stay in the box, the log-probability is that of their bin, and the deterministic action is the most
probable one.

Stored policies pickle `CategoricalPolicy` by its module path; moving or renaming the class makes them unreadable.
"""

from __future__ import annotations

from typing import Any, Self

import torch
from stable_baselines3.common.distributions import MultiCategoricalDistribution
from stable_baselines3.common.policies import ActorCriticPolicy
from stable_baselines3.common.type_aliases import Schedule

from agents.policies.spaces import check_actions


class BinnedDistribution(MultiCategoricalDistribution):
    """Independent categorical distributions over evenly spaced levels in [-1, 1], one for each action.

    Its arithmetic is its own: torch's Categorical makes a training half as long again.

    Args:
        bins: number of levels of each action.

    Attributes:
        log_probabilities: by action, those of the levels, shape (n, bins).
    """

    def __init__(self, bins: tuple[int, ...]) -> None:
        super().__init__(list(bins))
        self.greatest = torch.tensor(bins) - 1
        self.log_probabilities: list[torch.Tensor] = []

    def proba_distribution(self, action_logits: torch.Tensor) -> Self:
        """Set the distribution by logits, shape (n, all bins), and return it."""
        parts = action_logits.split_with_sizes(self.action_dims, dim=1)
        self.log_probabilities = [part.log_softmax(dim=1) for part in parts]
        return self

    def levels(self, numbers: torch.Tensor) -> torch.Tensor:
        """Return the actions, shape (..., m), of bins numbered from 0; both limits are exact."""
        return (2 * numbers - self.greatest) / self.greatest

    def numbers(self, actions: torch.Tensor) -> torch.Tensor:
        """Return the numbers of the bins nearest to actions, shape (..., m)."""
        return ((actions.clamp(-1, 1) + 1) / 2 * self.greatest).round().long()

    def log_prob(self, actions: torch.Tensor) -> torch.Tensor:
        """Return the log-probability of the bins nearest to actions (n, m), shape (n,)."""
        chosen = self.numbers(actions)
        parts = [part.gather(1, chosen[:, i : i + 1]) for i, part in enumerate(self.log_probabilities)]
        return torch.cat(parts, dim=1).sum(dim=1)

    def entropy(self) -> torch.Tensor:
        """Return the entropy, shape (n,)."""
        return -torch.cat([part.exp() * part for part in self.log_probabilities], dim=1).sum(dim=1)

    def sample(self) -> torch.Tensor:
        """Return random actions, shape (n, m): the largest of the logits with Gumbel noise."""
        noisy = [part - torch.empty_like(part).exponential_().log() for part in self.log_probabilities]
        return self._greatest(noisy)

    def mode(self) -> torch.Tensor:
        """Return the most probable actions, shape (n, m)."""
        return self._greatest(self.log_probabilities)

    def _greatest(self, parts: list[torch.Tensor]) -> torch.Tensor:
        return self.levels(torch.stack([part.argmax(dim=1) for part in parts], dim=1))


class CategoricalPolicy(ActorCriticPolicy):
    """Actor and critic whose actions are bins of the action box.

    Args:
        bins: number of levels of thrust and rate.
        values: positional arguments of ActorCriticPolicy: spaces and learning rate.
        arguments: its other arguments, such as net_arch.

    Raises:
        ValueError: for another action space than that of FlatQuad-v0.
    """

    def __init__(self, *values: Any, bins: tuple[int, int] = (3, 21), **arguments: Any) -> None:
        self.bins = tuple(bins)
        super().__init__(*values, **arguments)

    def _build(self, lr_schedule: Schedule) -> None:
        check_actions(self.action_space, exact=True)
        self.action_dist = BinnedDistribution(self.bins)
        super()._build(lr_schedule)

    def _get_constructor_parameters(self) -> dict[str, Any]:
        return super()._get_constructor_parameters() | {"bins": self.bins}
