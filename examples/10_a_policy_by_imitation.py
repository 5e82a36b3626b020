"""A small network learns to lead a cable past an obstacle by imitating the default controller.

The controller leads some episodes, with noise on its motions, so that the network sees how it comes back from where it
should not be (DART: Laskey et al. 2017). The network is then tried on cables of kinds that it did not see, beside the
controller. Needs the extras `gym` and `tang2025`, whose JAX trains the network:
`python examples/10_a_policy_by_imitation.py [EPISODES]`.
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
NOISE = 0.2  # standard deviation of the noise, in limits of the grippers
STEPS = 3000
WAITING = 0.01  # of an action with which the controller waits until its estimates have settled: nothing to learn


def features(seen):
    """Where the cable is, and how far from the goal, in decimetres, and the grippers' angles."""
    to_goal, grippers = seen["goal"] - seen["keypoints"], seen["grippers"]
    return np.concatenate([10 * seen["keypoints"].ravel(), 10 * to_goal.ravel(), grippers[:, 2]])


def episodes(count, plants, seed, policy=None, noise=0.0):
    """What was seen and what the controller would have done, in each step, and how many episodes succeeded."""
    env = gymnasium.make("cableway/Cable-v0", task=TASK, perturbations=plants, expert="rod-mpc", max_episode_steps=200)
    seen, wanted, successes, rng = [], [], 0, np.random.default_rng(seed)
    for episode in range(count):
        state, info = env.reset(seed=seed + episode)
        ended = False
        while not ended:
            row, advice = features(state), info["expert_action"]
            if np.abs(advice).max() > WAITING or info["error"] < 0.1:
                seen.append(row)
                wanted.append(advice.ravel())
            action = advice if policy is None else policy(row).reshape(2, 3)
            action = np.clip(action + rng.normal(scale=noise, size=(2, 3)), -1, 1)
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


def trained(seen, wanted, seed=0):
    """A policy fitted to all of that."""
    network = eqx.nn.MLP(seen.shape[1], wanted.shape[1], 128, 2, key=jax.random.key(seed))
    optimizer, rng = optax.adam(optax.cosine_decay_schedule(2e-3, STEPS)), np.random.default_rng(seed)
    state = optimizer.init(eqx.filter(network, eqx.is_array))
    for _ in range(STEPS):
        rows = rng.integers(len(seen), size=256)
        network, state, _ = step(network, state, optimizer, seen[rows], wanted[rows])
    fast = eqx.filter_jit(network)
    return lambda row: np.asarray(fast(row))


def main(count):
    """Train and try it."""
    seen, wanted, good = episodes(count, TRAINED_ON, 0, noise=NOISE)
    print(
        f"{len(seen)} steps to learn from; with noise the controller succeeds in {good} of {count} episodes", flush=True
    )
    _, _, good = episodes(TRIALS, TRIED_ON, 90_000, trained(seen, wanted))
    _, _, best = episodes(TRIALS, TRIED_ON, 90_000)
    print(f"on other cables the network succeeds in {good} of {TRIALS} episodes, the controller in {best}")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 10)
