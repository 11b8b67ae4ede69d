"""A vector environment checked in lockstep with scalar ones; Gymnasium's `check_env` is for scalar ones only.

    check_vector_env(gym.make_vec("CartPole-v1", 4, "sync"), lambda: gym.make("CartPole-v1"))

A flight is a sequence of calls, resets and steps, each noted with what it returned. Three kinds of law hold for it:

    protocol    each call by itself: spaces, shapes, the masks of infos, what the autoreset mode promises
    lockstep    env i returns what the scalar environment returns under the same seed and actions
    repetition  the same seed gives the same flight, also when the caller writes into the arrays he was given,
                and when those actions differ that must be ignored

Without `make_single` the lockstep is left out: for environments that draw all their starts from one generator, as
Gymnasium's own CartPole does, so that no scalar environment starts where theirs do.
"""

from flatgym.testing.lockstep import check_vector_env

__all__ = ["check_vector_env"]
