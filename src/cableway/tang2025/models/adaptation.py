"""Adapting a model to the cable at hand, while it works, without getting worse.

Of the latest transitions, every second block is held back. The others change a few parameters: those of the rod
where the model has one, else the last layer of its decoder, as Tang et al. freeze the encoders. The change is taken
only where it predicts the held-back blocks far better than the model in use.

Note:
    The paper fine-tunes its decoder and keeps whatever comes out, as `AdaptationConfig.paper()` does. Replay of earlier
    data, held-back data and the bound on outliers are ours.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Float, Int

from cableway.core.checks import Checked, NotNegative, Positive
from cableway.core.errors import InputError
from cableway.datasets.transitions import Transitions
from cableway.tang2025.models import dataset
from cableway.tang2025.models.base import rollout
from cableway.tang2025.models.dataset import Windows
from cableway.tang2025.models.frames import frame_of
from cableway.tang2025.models.learned import LearnedModel

LEAST_NOISE = 2e-3
"""Root mean square of the residuals, in lengths of the cable, below which they are not trusted further."""

ROD_SPREAD = (0.35, 0.5, 0.5 * 2 / 3, 0.4, 0.4 * 2 / 3, 0.05, 0.05)
"""How far the parameters of a rod may be from the first ones: damping, stiffness, rest, grasp. The second modes have
spreads of 0.5 and 0.4 as factors of x^2 - 1/3 = 2/3 P_2."""

WEIGHT_SPREAD = 0.1
"""The same for the weights of a last layer, as a share of their root mean square."""

ITERATIONS = 3
"""Gauss-Newton steps of a fit."""

OUTLIER = 3.0
"""Windows with residuals above so many times the median count less, in inverse proportion; above the square of it, not
at all."""

HOLD_EVERY = 2
"""One block in so many is held back."""

MEMORY = 200
"""Transitions remembered, the last ones."""

BLOCK = 10
"""Successive transitions in a block; held-back blocks are predicted over their whole length."""

WINDOW = 5
"""Steps of the rollouts that a rod is fitted to; the last layer of a network is fitted to single steps."""

LEAST_HELD = 3
"""Fewest held-back blocks that a change is judged by."""

LEAST_MOTION = 2e-3
"""Travel of the grippers [m] in a window below which it says nothing."""

SPOILT = 10.0
"""Error of a window in that of the median window, both after a change, from which on it was measured wrong."""


@dataclass(frozen=True, kw_only=True)
class AdaptationConfig(Checked):
    """How a model is adapted; the defaults are those for a rod, `for_network()` has the other ones.

    Attributes:
        windows: Most windows in a fit, and most that are replayed.
        held_windows: Most held-back blocks.
        enough: Error on held-back blocks, in lengths of the cable, below which nothing is changed: what a hundred
            transitions of one or two motions show of smaller errors often holds for these motions only.
        improvement: Share of the error on held-back blocks that a change must take away; where None, every change is
            taken. One that explains only part of it, say by stiffness in place of friction, often predicts other
            motions worse.
    """

    windows: Positive[int] = 48
    held_windows: Positive[int] = 8
    enough: NotNegative[float] = 0.01
    improvement: NotNegative[float] | None = 0.92

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.improvement is not None and not self.improvement < 1:
            raise InputError(f"adaptation.improvement must be from 0 to below 1, got {self.improvement!r}")

    @classmethod
    def for_network(cls) -> AdaptationConfig:
        """Settings for a network: its last layer is drawn to its training data, so it changes and explains less."""
        return cls(enough=0.005, improvement=0.5)

    @classmethod
    def paper(cls) -> AdaptationConfig:
        """As in Tang et al.: whatever comes out is taken, however small the error was."""
        return cls(enough=0.0, improvement=None)


@dataclass(frozen=True)
class AdaptationState:
    """A model that adapts.

    Attributes:
        model: In use.
        config: How it adapts.
        first: Parameters it began with; the fit is drawn towards them.
        replay: Windows of earlier data that a network is to keep predicting.
        recent: The latest transitions.
        accepted: Updates taken.
        refused: Updates that predicted the held-back blocks no better.
    """

    model: LearnedModel
    config: AdaptationConfig
    first: Float[np.ndarray, "p"]
    replay: Windows | None = None
    recent: Transitions | None = None
    accepted: int = 0
    refused: int = 0


def start_adaptation(
    model: LearnedModel, *, replay: Transitions | None = None, config: AdaptationConfig | None = None, seed: int = 0
) -> AdaptationState:
    """The state before the first transition.

    Args:
        model: The model as trained.
        replay: Earlier data, say those it was trained on; a rod needs none.
        config: How to adapt; the settings for a rod or for a network where None.
        seed: Of the choice among the earlier data.
    """
    config = config or (AdaptationConfig.for_network() if model.rod is None else AdaptationConfig())
    old = None
    if replay is not None and model.rod is None:
        starts = np.random.default_rng(seed).permutation(len(replay))[: config.windows]
        old = dataset.windows(replay, np.resize(starts, config.windows), 1)
    return AdaptationState(model, config, np.asarray(parameters_of(model), float), old)


def compile_adaptation(state: AdaptationState, keypoints: int) -> None:
    """Compile what `adapt` needs for cables of so many keypoints, so that no update waits for it."""
    config = state.config
    batch = _nothing(config.windows, _horizon(state), keypoints)
    if state.replay is not None:
        batch = Windows(*(jnp.concatenate(parts) for parts in zip(batch, state.replay, strict=True)))
    fit(state.model, batch, state.first, iterations=1)
    jax.block_until_ready(_errors(state.model, _nothing(config.held_windows, BLOCK, keypoints)))


def _nothing(count: int, steps: int, keypoints: int) -> Windows:
    """Windows full of zeros."""
    shapes = (keypoints, 2), (2, 3), (steps, 2, 3), (steps, keypoints, 2)
    return Windows(*(jnp.zeros((count, *shape)) for shape in shapes))


def _horizon(state: AdaptationState) -> int:
    """Steps of the windows that the model is fitted to."""
    return 1 if state.model.rod is None else WINDOW


def adapt(state: AdaptationState, transitions: Transitions) -> AdaptationState:
    """Take in new transitions, and a changed model if it predicts better what was held back.

    `transitions` leaves out missing frames; poses show which rows of an episode do not follow each other. Transitions
    without motion are remembered but change nothing.

    Args:
        state: As it was.
        transitions: The newest ones, in order; their episodes are numbered on from those before, or are the same.

    Raises:
        InputError: They have another number of keypoints than those before.
    """
    config = state.config
    recent = _remembered(state.recent, transitions)
    state = replace(state, recent=recent)
    training, held = _blocks(recent)
    horizon = _horizon(state)
    windows = _informative(recent, _inside(training, horizon), horizon)
    judges = _informative(recent, held, BLOCK)
    if not len(windows) or len(judges) < LEAST_HELD:
        return state
    # rows repeat, so that compiled code always sees the same shapes
    chosen = judges[-config.held_windows :]
    test = dataset.windows(recent, np.resize(chosen, config.held_windows), BLOCK)
    before = np.asarray(_errors(state.model, test), float)[: len(chosen)]
    limit = OUTLIER * np.median(before)
    if np.minimum(before, limit).mean() < config.enough * _length(recent):
        return state
    batch = dataset.windows(recent, np.resize(_spread(windows, config.windows), config.windows), horizon)
    if state.replay is not None:
        batch = Windows(*(jnp.concatenate(parts) for parts in zip(batch, state.replay, strict=True)))
    candidate = fit(state.model, batch, state.first)
    after = np.asarray(_errors(candidate, test), float)[: len(chosen)]
    better = config.improvement is None or _explained(before, after, limit) > config.improvement
    if np.isfinite(after).all() and better:
        return replace(state, model=candidate, accepted=state.accepted + 1)
    return replace(state, refused=state.refused + 1)


def _explained(before: Float[np.ndarray, "k"], after: Float[np.ndarray, "k"], limit: float) -> float:
    """The share of the error that a change takes away; 0 where it adds to it.

    Windows that it leaves `SPOILT` times as far off as it leaves the median one were measured wrong: they say nothing
    of the share. Errors above `limit` [m] count as that much in what must not grow.
    """
    if np.minimum(after, limit).mean() >= np.minimum(before, limit).mean():
        return 0.0
    kept = after <= SPOILT * np.sort(after)[(len(after) - 1) // 2]
    return 1.0 - float(after[kept].sum() / max(before[kept].sum(), 1e-12))


def _length(data: Transitions) -> float:
    """Length [m] of the polyline through the keypoints."""
    return float(np.median(np.linalg.norm(np.diff(data.keypoints, axis=1), axis=2).sum(axis=1)))


def _remembered(recent: Transitions | None, new: Transitions) -> Transitions:
    if recent is None:
        return dataset.select(new, np.arange(len(new))[-MEMORY:])
    if recent.keypoints.shape[1] != new.keypoints.shape[1]:
        raise InputError(
            f"transitions to adapt to have {new.keypoints.shape[1]} keypoints, those before {recent.keypoints.shape[1]}"
        )
    return dataset.select(dataset.appended([recent, new]), np.arange(len(recent) + len(new))[-MEMORY:])


def _blocks(data: Transitions) -> tuple[Int[np.ndarray, "b"], Int[np.ndarray, "h"]]:
    """First rows of the blocks to learn from, and of those held back; blocks do not overlap."""
    gap = np.abs(data.poses[1:] - data.poses[:-1] - data.actions[:-1]).max(axis=(1, 2)) > 1e-6
    runs = np.concatenate([[0], np.cumsum(gap | (np.diff(data.episode) != 0))])
    starts = dataset.window_starts(runs, BLOCK, BLOCK)
    held = np.arange(len(starts)) % HOLD_EVERY == HOLD_EVERY - 1
    return starts[~held], starts[held]


def _inside(starts: Int[np.ndarray, "b"], horizon: int) -> Int[np.ndarray, "k"]:
    """Rows at which windows begin that lie within blocks."""
    return (starts[:, None] + np.arange(BLOCK - horizon + 1)).ravel()


def _informative(data: Transitions, starts: Int[np.ndarray, "k"], horizon: int) -> Int[np.ndarray, "j"]:
    """Those windows in which the grippers move."""
    travel = np.abs(data.actions[starts[:, None] + np.arange(horizon), :, :2]).sum(axis=(1, 2, 3))
    turn = np.abs(data.actions[starts[:, None] + np.arange(horizon), :, 2]).sum(axis=(1, 2))
    return starts[travel + 0.1 * _length(data) * turn > LEAST_MOTION * horizon / WINDOW]


def _spread(rows: Int[np.ndarray, "k"], most: int) -> Int[np.ndarray, "j"]:
    """At most so many of the rows, evenly spread."""
    return rows[np.unique(np.linspace(0, len(rows) - 1, min(most, len(rows))).round().astype(int))]


@eqx.filter_jit
def _errors(model: LearnedModel, windows: Windows) -> Float[Array, "k"]:
    """Mean stacked error over the steps of each window [m]."""
    shapes = jax.vmap(lambda *window: rollout(model, *window))(*windows[:3])
    return jnp.mean(jnp.sqrt(jnp.sum((shapes - windows.targets) ** 2, axis=(2, 3))), axis=1)


def adaptable(model: LearnedModel) -> LearnedModel:
    """A tree of booleans: the parameters of the rod where there is one, else the last layer of the network."""
    nothing = jax.tree.map(lambda _: False, model)
    if model.rod is not None:
        return eqx.tree_at(lambda tree: tree.rod, nothing, jax.tree.map(lambda _: True, model.rod))
    return eqx.tree_at(lambda tree: tree.last_layer, nothing, jax.tree.map(lambda _: True, model.last_layer))


def parameters_of(model: LearnedModel) -> Float[Array, "p"]:
    """The parameters that may change, as one list."""
    return ravel_pytree(eqx.filter(model, adaptable(model)))[0]


def with_parameters(model: LearnedModel, values: Float[Array, "p"]) -> LearnedModel:
    """The model with other parameters."""
    part, rest = eqx.partition(model, adaptable(model))
    return eqx.combine(ravel_pytree(part)[1](values), rest)


def fit(
    model: LearnedModel, batch: Windows, first: Float[np.ndarray, "p"], iterations: int = ITERATIONS
) -> LearnedModel:
    """The model with parameters that predict the windows best.

    Minimises the mean squared residual of each window over its variance plus the squared distance to `first` over its
    own. A window counts once, however many numbers it has: what a model cannot describe errs alike in all of them. A
    rod is fitted without what it keeps of the shape, which would hide what the parameters are to explain.

    Args:
        model: Where to begin.
        batch: Windows.
        first: Where the parameters are drawn to.
        iterations: Gauss-Newton steps.

    Note:
        A fixed number of steps on what JAX has compiled, and a change that does not help is refused afterwards: there
        is no damping to choose, as `cableway.rod.least_squares` does.
    """
    values = np.asarray(parameters_of(model), float)
    described = model if model.rod is None else eqx.tree_at(lambda m: m.rod, model, model.rod.keeping_nothing())
    spread = np.array(ROD_SPREAD) if model.rod is not None else WEIGHT_SPREAD * np.sqrt(np.mean(first**2) + 1e-12)
    pull = np.broadcast_to(1.0 / np.square(spread), values.shape)
    for _ in range(iterations):
        matrix, right, variance = _normal_equations(described, jnp.asarray(values, jnp.float32), batch)
        noise = max(float(variance), LEAST_NOISE**2) * batch.targets[0].size
        system = np.asarray(matrix, float) / noise + np.diag(pull)
        values = values - np.linalg.solve(system, np.asarray(right, float) / noise + pull * (values - first))
    return with_parameters(model, jnp.asarray(values, jnp.float32))


@eqx.filter_jit
def _normal_equations(
    model: LearnedModel, values: Float[Array, "p"], batch: Windows
) -> tuple[Float[Array, "p p"], Float[Array, "p"], Float[Array, ""]]:
    """J' W J, J' W r and the variance of the residuals r, in lengths of the cable."""

    def residuals(values: Array) -> Float[Array, "k r"]:
        changed = with_parameters(model, values)

        def window(keypoints: Array, poses: Array, actions: Array, targets: Array) -> Array:
            left = rollout(changed, keypoints, poses, actions) - targets
            return (left / frame_of(model.config.framing, keypoints, poses).unit).ravel()

        return jax.vmap(window)(*batch)

    missed, slopes = residuals(values), jax.jacfwd(residuals)(values)
    size = jnp.sqrt(jnp.mean(missed**2, axis=1))
    sound = jnp.isfinite(size) & jnp.all(jnp.isfinite(slopes), axis=(1, 2))
    typical = jnp.nanmedian(jnp.where(sound, size, jnp.nan))
    # a window that is far out has lost its shape, and its slopes with it
    sound = sound & (size <= OUTLIER**2 * typical)
    missed, slopes = jnp.where(sound[:, None], missed, 0.0), jnp.where(sound[:, None, None], slopes, 0.0)
    weight = jnp.minimum(1.0, OUTLIER * typical / (jnp.where(sound, size, 1.0) + 1e-12))
    matrix = jnp.einsum("k,krp,krq->pq", weight, slopes, slopes)
    return matrix, jnp.einsum("k,krp,kr->p", weight, slopes, missed), typical**2
