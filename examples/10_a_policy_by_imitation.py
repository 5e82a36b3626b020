"""A small network learns to lead a cable past an obstacle by imitating the default controller.

In each round the network leads some episodes, in the first the controller, and learns what the controller would have
done in every state (DAgger: Ross, Gordon and Bagnell 2011). It is then tried on cables of kinds that it did not see,
beside the controller. Needs the extras `gym` and `tang2025`, whose JAX trains the network:
`python examples/10_a_policy_by_imitation.py [ROUNDS] [EPISODES]`.
"""

import sys

import equinox as eqx
import gymnasium
import jax
import jax.numpy as jnp
import numpy as np
import optax

import cableway.envs  # noqa: F401  makes the environment known

TASK = "single-obstacle-2"
TRAINED_ON = ("nominal", "long-1", "short-1", "friction")
TRIED_ON = ("hard", "graded", "grasp")
TRIALS = 12
STEPS = 2000
WAITING = 0.01  # of an action with which the controller waits until its estimates have settled: nothing to learn


def features(seen):
    """Where the cable is, and how far from the goal, in decimetres, and the grippers' angles."""
    to_goal, grippers = seen["goal"] - seen["keypoints"], seen["grippers"]
    return np.concatenate([10 * seen["keypoints"].ravel(), 10 * to_goal.ravel(), grippers[:, 2]])


def episodes(count, plants, seed, policy=None):
    """What was seen and what the controller would have done, in each step, and how many episodes succeeded."""
    env = gymnasium.make("cableway/Cable-v0", task=TASK, perturbations=plants, expert="rod-mpc")
    seen, wanted, successes = [], [], 0
    for episode in range(count):
        state, info = env.reset(seed=seed + episode)
        ended = False
        while not ended:
            row, advice = features(state), info["expert_action"]
            if np.abs(advice).max() > WAITING or info["error"] < 0.03:
                seen.append(row)
                wanted.append(advice.ravel())
            action = advice if policy is None else np.clip(policy(row), -1, 1).reshape(2, 3)
            state, _, terminated, truncated, info = env.step(action)
            ended = terminated or truncated
        successes += info["success"]
    return np.array(seen, np.float32), np.array(wanted, np.float32), successes


@eqx.filter_jit
def step(network, state, optimizer, seen, wanted):
    """One step of gradient descent on the squared error."""

    def loss(network):
        return jnp.mean((jax.vmap(network)(seen) - wanted) ** 2)

    value, slope = eqx.filter_value_and_grad(loss)(network)
    change, state = optimizer.update(slope, state)
    return eqx.apply_updates(network, change), state, value


def trained(seen, wanted, seed):
    """A policy fitted to all of that."""
    network = eqx.nn.MLP(seen.shape[1], wanted.shape[1], 128, 2, key=jax.random.key(seed))
    optimizer, rng = optax.adam(optax.cosine_decay_schedule(2e-3, STEPS)), np.random.default_rng(seed)
    state = optimizer.init(eqx.filter(network, eqx.is_array))
    for _ in range(STEPS):
        rows = rng.integers(len(seen), size=256)
        network, state, _ = step(network, state, optimizer, seen[rows], wanted[rows])
    fast = eqx.filter_jit(network)
    return lambda row: np.asarray(fast(row))


def main(rounds, count):
    """Train and try it."""
    seen, wanted, _ = episodes(count, TRAINED_ON, 0)
    for number in range(1, rounds + 1):
        policy = trained(seen, wanted, number)
        more, asked, good = episodes(count, TRAINED_ON, 1000 * number, policy)
        print(f"round {number}: {len(seen)} steps learned from, then {good} of {count} episodes succeed", flush=True)
        seen, wanted = np.concatenate([seen, more]), np.concatenate([wanted, asked])
    _, _, good = episodes(TRIALS, TRIED_ON, 90_000, trained(seen, wanted, 0))
    _, _, best = episodes(TRIALS, TRIED_ON, 90_000)
    print(f"on other cables the network succeeds in {good} of {TRIALS} episodes, the controller in {best}")


if __name__ == "__main__":
    main(*(int(number) for number in sys.argv[1:] or (2, 6)))
