"""The optimised deformation: energy, exact derivatives, bounds, guesses, and Ipopt behind its one door."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.sparse

from cableway.core.errors import InputError, PlanningError, UnknownNameError
from cableway.geometry import polyline, se2
from cableway.scene.cable import Cable
from cableway.tang2025.planning.config import DeformationConfig, paper_planner
from cableway.tang2025.planning.deformation import first_guess, optimize_deformation
from cableway.tang2025.planning.ipopt import LinearLimits, Objective, minimize
from cableway.tang2025.planning.path_curves import PathCurves, SigmoidCurves, SplineCurves
from cableway.tang2025.planning.path_set import PathSet
from cableway.tang2025.planning.springs import Springs, pattern

CABLE = Cable()
REST = CABLE.length / 12
STRAIGHT = np.column_stack([np.linspace(0.0, CABLE.length, 13), np.zeros(13)])
SPRINGS = Springs(REST, (100.0, 3.0), 0.1, 0.5)
SHORT = DeformationConfig(steps=20, iterations=60, upper_bound=0.2)


def sliding_set(points: int = 60) -> PathSet:
    """A cable pulled lengthwise along an S by twice its length: a way without any stretch exists."""
    length = 3 * CABLE.length
    s = np.linspace(0.0, length, 2000)
    angle = 0.8 * np.sin(2 * np.pi * s / length)
    steps = np.diff(s)[:, None] * se2.direction(0.5 * (angle[1:] + angle[:-1]))
    route = np.vstack([[0.0, 0.0], np.cumsum(steps, axis=0)])
    lengths = np.linspace(0.0, 2 * CABLE.length, points)
    paths = np.array([polyline.point_at(route, i * REST + lengths) for i in range(13)])
    return PathSet(paths, paths[6], np.empty((0, 2, 2)))


def turning_set() -> PathSet:
    """A straight cable, moved and turned by a right angle."""
    goal = se2.transform(STRAIGHT - STRAIGHT[6], np.array([0.5, 0.4]), np.pi / 2)
    share = np.linspace(0.0, 1.0, 30)[:, None]
    paths = np.array([(1 - share) * a + share * b for a, b in zip(STRAIGHT, goal, strict=True)])
    return PathSet(paths, paths[6], np.empty((0, 2, 2)))


CURVES: dict[str, PathCurves] = {
    "spline": SplineCurves(sliding_set(20).paths),
    "sigmoid": SigmoidCurves(sliding_set(20).paths, 3.0),
}


# ------------------------------------------------------------------------------------------------ energy
def test_energy_is_zero_for_the_straight_cable_and_positive_else():
    bent = np.column_stack([np.sin(np.linspace(0, 1, 13)), np.cos(np.linspace(0, 1, 13))]) * CABLE.length
    energy = SPRINGS.shape_energy(np.stack([STRAIGHT, 1.01 * STRAIGHT, 0.99 * STRAIGHT, bent]))
    assert energy[0] == pytest.approx(0.0, abs=1e-15)
    assert np.all(energy[1:] > 1e-8)


def test_energy_of_a_stretched_cable_is_hooke_s():
    """12 springs stretched by 1% of l and 11 by 1% of 2 l."""
    expected = 0.5 * 100.0 * 12 * (0.01 * REST) ** 2 + 0.5 * 3.0 * 11 * (0.02 * REST) ** 2
    assert SPRINGS.shape_energy(1.01 * STRAIGHT[None])[0] == pytest.approx(float(expected), rel=1e-6)


def test_energy_does_not_change_under_rigid_motion():
    rng = np.random.default_rng(0)
    shape = STRAIGHT + rng.normal(0, 0.01, STRAIGHT.shape)
    moved = se2.transform(shape, np.array([0.3, -0.2]), 2.1)
    energy = SPRINGS.shape_energy(np.stack([shape, moved, shape[::-1]]))
    assert energy == pytest.approx(np.full(3, energy[0]))


@pytest.mark.parametrize("name", CURVES)
def test_curves_derivatives_match_finite_differences(name: str):
    curves = CURVES[name]
    sigma = np.random.default_rng(1).uniform(0.02, 0.98, (4, 13))
    h = 1e-5
    before, at, after = curves(sigma - h), curves(sigma), curves(sigma + h)
    assert at[1] == pytest.approx((after[0] - before[0]) / (2 * h), abs=1e-4)
    assert at[2] == pytest.approx((after[1] - before[1]) / (2 * h), abs=1e-2, rel=1e-3)


def test_the_spline_meets_its_waypoints_and_has_continuous_second_derivatives():
    path_set = sliding_set(20)
    knots = np.linspace(0.0, 1.0, 20)
    curves = SplineCurves(path_set.paths)
    sigma = np.repeat(knots[:, None], 13, axis=1)
    assert np.swapaxes(curves(sigma)[0], 0, 1) == pytest.approx(path_set.paths, abs=1e-12)
    inner = sigma[1:-1]
    assert curves(inner - 1e-9)[2] == pytest.approx(curves(inner + 1e-9)[2], abs=1e-4)


def test_a_sharp_sigmoid_runs_along_the_polyline():
    """With a large a the weighted segments are the polyline itself, away from its vertices."""
    path_set = sliding_set(20)
    sigma = np.repeat(((np.arange(19) + 0.5) / 19)[:, None], 13, axis=1)
    middle = 0.5 * (path_set.paths[:, :-1] + path_set.paths[:, 1:])
    assert np.swapaxes(SigmoidCurves(path_set.paths, 50.0)(sigma)[0], 0, 1) == pytest.approx(middle, abs=1e-9)


def jax_value(coefficients: np.ndarray, sigma: jax.Array, springs: Springs) -> jax.Array:
    """The objective again, in JAX, on paths that are cubic polynomials with (4, n, 2) coefficients."""
    x = sum(coefficients[3 - k][None] * sigma[..., None] ** k for k in range(4))
    total = jnp.sum(0.5 * springs.step_stiffness * springs.travel**2 * jnp.diff(sigma, axis=0) ** 2)
    for stride, k in enumerate(springs.stiffness, start=1):
        d = jnp.sqrt(jnp.sum((x[:, stride:] - x[:, :-stride]) ** 2, axis=2))
        total += jnp.sum(0.5 * k * (d - stride * springs.rest) ** 2)
    return total / springs.rest**2


def test_gradient_and_hessian_match_jax():
    """Paths of 4 waypoints are one cubic each, so the same curve is easily written in JAX."""
    rng = np.random.default_rng(2)
    knots = np.linspace(0.0, 1.0, 4)
    paths = STRAIGHT[:, None] + rng.normal(0, 0.1, (13, 4, 2))
    vandermonde = np.vander(knots, 4)
    coefficients = np.moveaxis(np.linalg.solve(vandermonde, paths), 1, 0)
    curves = SplineCurves(paths)
    sigma = np.sort(rng.uniform(0.0, 1.0, (6, 13)), axis=0)
    with jax.enable_x64(True):
        value = lambda s: jax_value(coefficients, s, SPRINGS)  # noqa: E731
        everything = jax.jit(lambda s: (value(s), jax.grad(value)(s), jax.hessian(value)(s)))
        expected, gradient, hessian = (np.asarray(part) for part in everything(jnp.asarray(sigma)))
    hessian = hessian[1:-1, :, 1:-1].reshape(52, 52)
    assert SPRINGS.value(sigma, curves) == pytest.approx(float(expected), rel=1e-9)
    assert SPRINGS.gradient(sigma, curves) == pytest.approx(gradient, rel=1e-7, abs=1e-7)
    rows, columns = pattern(4, 13)
    ours = np.zeros((52, 52))
    ours[rows, columns] = SPRINGS.hessian(sigma, curves)
    assert np.all(rows <= columns)
    assert ours == pytest.approx(np.triu(hessian), rel=1e-6, abs=1e-5)


# ------------------------------------------------------------------------------------------------ first guesses
@pytest.mark.parametrize("bounds", [(0.0, 0.1), (0.01, 0.1), (0.0, 0.02), (0.02, 0.02), (0.0, 0.5)])
@pytest.mark.parametrize("guess", ["head", "tail", "uniform"])
def test_a_first_guess_keeps_the_bounds(guess: str, bounds: tuple[float, float]):
    config = DeformationConfig(steps=50, lower_bound=bounds[0], upper_bound=bounds[1])
    sigma = first_guess(sliding_set(), CABLE, config, guess)  # pyright: ignore[reportArgumentType]
    steps = np.diff(sigma, axis=0)
    assert sigma[0] == pytest.approx(np.zeros(13), abs=1e-12)
    assert sigma[-1] == pytest.approx(np.ones(13), abs=1e-12)
    assert steps.min() >= bounds[0] - 1e-12
    assert steps.max() <= bounds[1] + 1e-12


def test_head_means_that_the_last_keypoint_leads():
    config = DeformationConfig()
    head, tail, uniform = (
        first_guess(sliding_set(), CABLE, config, guess)[25] for guess in ("head", "tail", "uniform")
    )
    assert np.all(np.diff(head) > 0)
    assert np.all(np.diff(tail) < 0)
    assert np.ptp(uniform) == 0


# ------------------------------------------------------------------------------------------------ optimisation
@pytest.mark.parametrize("interpolation", ["spline", "sigmoid"])
@pytest.mark.parametrize("guess", ["head", "tail", "uniform"])
def test_progress_is_monotone_and_the_ends_are_exact(guess: str, interpolation: str):
    path_set = turning_set()
    config = DeformationConfig(steps=12, iterations=15, upper_bound=0.3, interpolation=interpolation)  # pyright: ignore
    sequence = optimize_deformation(path_set, CABLE, config, guess)  # pyright: ignore[reportArgumentType]
    steps = np.diff(sequence.progress, axis=0)
    assert sequence.shapes.shape == (13, 13, 2)
    assert np.array_equal(sequence.shapes[0], path_set.paths[:, 0])
    assert np.array_equal(sequence.shapes[-1], path_set.paths[:, -1])
    assert np.array_equal(sequence.progress[[0, -1]], [np.zeros(13), np.ones(13)])
    assert steps.min() >= 0
    assert steps.max() <= 0.3 + 1e-6


def test_the_lower_bound_is_kept():
    config = DeformationConfig(steps=20, iterations=40, lower_bound=0.02, upper_bound=0.2)
    steps = np.diff(optimize_deformation(turning_set(), CABLE, config, "head").progress, axis=0)
    assert steps.min() >= 0.02 - 1e-6


def test_where_a_way_without_stretch_exists_it_is_found():
    """Sliding lengthwise, uniform progress is an exact solution; the head-first guess ends there too."""
    for guess in ("uniform", "head"):
        sequence = optimize_deformation(sliding_set(), CABLE, SHORT, guess)
        length = polyline.length(polyline.spline(sequence.shapes, 6))
        assert np.abs(length / CABLE.length - 1).max() < 0.01


def test_the_energy_falls_below_that_of_the_guess():
    path_set = turning_set()
    springs = Springs(REST, (100.0, 1.0), 0.0, 1.0)
    curves = SplineCurves(path_set.paths)
    before = springs.value(first_guess(path_set, CABLE, SHORT, "head"), curves)
    after = springs.value(optimize_deformation(path_set, CABLE, SHORT, "head").progress, curves)
    assert after < 0.7 * before


def test_more_step_stiffness_gives_more_even_steps():
    most = []
    for stiffness in (0.0, 1.0):
        config = DeformationConfig(steps=20, iterations=60, upper_bound=0.2, step_stiffness=stiffness)
        sequence = optimize_deformation(turning_set(), CABLE, config, "head")
        most.append(np.linalg.norm(np.diff(sequence.shapes, axis=0), axis=2).max())
    assert most[1] < 0.8 * most[0]


def test_the_same_input_gives_the_same_sequence_in_silence(capfd: pytest.CaptureFixture[str]):
    first, second = (optimize_deformation(turning_set(), CABLE, SHORT, "tail") for _ in range(2))
    assert np.array_equal(first.shapes, second.shapes)
    assert capfd.readouterr() == ("", "")


def test_progress_is_reported_and_never_beyond_one():
    seen: list[tuple[str, float]] = []
    optimize_deformation(turning_set(), CABLE, SHORT, "uniform", lambda stage, share: seen.append((stage, share)))
    assert len(seen) > 2
    assert {stage for stage, _ in seen} == {"deformation"}
    shares = [share for _, share in seen]
    assert shares == sorted(shares)
    assert shares[-1] == 1.0


def test_paths_of_length_zero_are_stood_still_on():
    paths = np.repeat(STRAIGHT[:, None], 10, axis=1)
    sequence = optimize_deformation(PathSet(paths, paths[6], np.empty((0, 2, 2))), CABLE, SHORT, "head")
    assert np.abs(sequence.shapes - STRAIGHT).max() < 1e-12


# ------------------------------------------------------------------------------------------------ Ipopt
def quadratic(centre: np.ndarray) -> Objective:
    """|x - centre|^2."""
    index = np.arange(len(centre))
    return Objective(
        lambda x: float(np.sum((x - centre) ** 2)),
        lambda x: 2 * (x - centre),
        lambda x: np.full(len(centre), 2.0),
        index,
        index,
    )


def limits(rows: list[list[float]], low: float, high: float, bound: float = 10.0) -> LinearLimits:
    matrix = scipy.sparse.csr_array(np.array(rows))
    m = matrix.shape[1]  # pyright: ignore[reportOptionalSubscript]
    ends = (np.full(len(rows), low), np.full(len(rows), high))
    return LinearLimits(np.full(m, -bound), np.full(m, bound), matrix, *ends)


def test_ipopt_projects_onto_a_plane():
    found = minimize(quadratic(np.array([1.0, 2.0, 3.0])), limits([[1.0, 1.0, 1.0]], 0.0, 0.0), np.zeros(3), 50)
    assert found.x == pytest.approx([-1.0, 0.0, 1.0], abs=1e-6)
    assert found.converged
    assert 0 < found.iterations < 50


def test_ipopt_minimises_rosenbrock_with_its_full_hessian():
    """Entries off the diagonal must land where the pattern says."""
    rosenbrock = Objective(
        lambda x: float(100 * (x[1] - x[0] ** 2) ** 2 + (1 - x[0]) ** 2),
        lambda x: np.array([-400 * x[0] * (x[1] - x[0] ** 2) - 2 * (1 - x[0]), 200 * (x[1] - x[0] ** 2)]),
        lambda x: np.array([200.0, -400 * x[0], 1200 * x[0] ** 2 - 400 * x[1] + 2]),
        np.array([1, 0, 0]),
        np.array([1, 1, 0]),
    )
    found = minimize(rosenbrock, limits([[1.0, 0.0]], -10.0, 10.0), np.array([-1.2, 1.0]), 60)
    assert found.x == pytest.approx([1.0, 1.0], abs=1e-4)
    assert found.converged
    stopped = minimize(rosenbrock, limits([[1.0, 0.0]], -10.0, 10.0), np.array([-1.2, 1.0]), 5)
    assert (stopped.converged, stopped.status, stopped.iterations) == (False, "Maximum_Iterations_Exceeded", 5)


def test_limits_that_contradict_each_other_are_a_planning_error():
    with pytest.raises(PlanningError, match="Ipopt found no feasible answer \\(Infeasible"):
        minimize(quadratic(np.ones(2)), limits([[1.0, 1.0]], 5.0, 6.0, bound=1.0), np.zeros(2), 100)


def test_not_a_number_is_a_planning_error():
    broken = quadratic(np.ones(2))
    index = broken.rows
    bad = Objective(lambda x: float("nan"), broken.gradient, broken.hessian, index, index)
    with pytest.raises(PlanningError, match="Ipopt"):
        minimize(bad, limits([[1.0, 1.0]], -1.0, 1.0), np.zeros(2), 20)


# ------------------------------------------------------------------------------------------------ configuration
def test_paper_s_values():
    paper = paper_planner()
    assert (paper.pivot.method, paper.pivot.length_weight, paper.pivot.clearance_weight) == ("rrt_star", 1.0, 1.0)
    assert paper.path_set.kind == "transfer"
    deformation = paper.deformation
    assert (deformation.steps, deformation.near_stiffness, deformation.far_stiffness) == (50, 2.0, 1.0)
    assert (deformation.lower_bound, deformation.upper_bound) == (0.01, 0.1)
    assert (deformation.interpolation, deformation.step_stiffness) == ("sigmoid", 0.0)


def test_bounds_that_cannot_reach_one_are_refused():
    with pytest.raises(InputError, match=r"cannot reach 1 in 50 steps of 0 to 0\.01"):
        DeformationConfig(upper_bound=0.01)
    with pytest.raises(InputError, match=r"cannot reach 1 in 50 steps of 0\.05 to 0\.1"):
        DeformationConfig(lower_bound=0.05)


def test_an_unknown_interpolation_lists_the_known_ones():
    with pytest.raises(UnknownNameError, match="'linear'; known: sigmoid, spline"):
        DeformationConfig(interpolation="linear")  # pyright: ignore[reportArgumentType]
