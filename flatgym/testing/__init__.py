"""A checker for vector environments; Gymnasium's `check_env` is for scalar environments only.

    check_vector_env(gym.make_vec("CartPole-v1", 4, "sync"), lambda: gym.make("CartPole-v1"))

A rollout is a sequence of calls, resets and steps, each recorded with its results. The checker verifies three kinds of
properties:

    protocol    each call on its own: spaces, shapes, masks of infos, the autoreset mode
    lockstep    env i returns the same as the scalar environment with the same seed and actions
    repetition  the same seed gives the same rollout, also if the caller writes into returned arrays, and with other
                actions wherever actions must be ignored

Without `make_single` there is no lockstep check. This suits environments that sample all start states from one
generator, such as Gymnasium's own CartPole, for which no scalar environment has the same starts.
"""

from flatgym.testing.lockstep import check_vector_env

__all__ = ["check_vector_env"]
