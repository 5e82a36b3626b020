"""The cable: what it measures, how it bends, and what resists it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import Annotated, Any

import numpy as np
from jaxtyping import Float

from cableway.core.errors import InputError, TaskError
from cableway.core.quantities import limit_text
from cableway.rod.material import GRAVITY
from cableway.rod.planar import PlanarRod
from cableway.scene import checks
from cableway.scene.checks import Quantity
from cableway.scene.files.presets import preset_names, preset_ranges

KEYPOINTS = (3, 200)
"""Least and largest number of keypoints."""

MOST_VALUES = 200
"""Largest number of values along the length."""

MOST_TURNS = 2.0
"""Full turns to which a cable at rest may be curled."""

CURVATURE = Quantity("1/m")

Curvature = Annotated[float, CURVATURE]

PROFILES = {"stiffness_profile": Quantity("", 1e-3, 1e3), "rest_curvature": CURVATURE}
"""Fields that hold values along the length, and what each value is."""

DRAWN_VALUES = 3
"""Values along the length of a cable drawn at random: left end, middle, right end."""

FIRST_MODE = 4.730
"""Wave number times length of a clamped beam's first bending mode: cos(x) cosh(x) = 1."""

QUASI_STATIC = 2.0
"""Frequency [Hz] of the first bending mode from which a cable moves as its equilibria do. Slower ones swing."""

LONGEST_SWING = 10.0
"""Period [s] that is allowed for at most: what waits for a swing has to end, and what is put down to it is to be small.
Nothing slower than 6 s was tried."""

FRICTION_RULES = 100.0
"""`Cable.friction_number` from which friction may hold the cable back by 10 cm and more: in the suite "limp" the
largest deviation is 12 mm at 30 and 157 mm at 100, in the median."""

LOGARITHMIC = ("bending_stiffness", "damping_time", "stiffness_profile")
"""Fields drawn uniformly in their logarithm: what is known of them is a factor."""

Seed = int | np.random.SeedSequence | np.random.Generator


@dataclass(frozen=True, kw_only=True)
class Cable:
    """A cable held at both ends.

    The default is the nominal cable: uniform, elastic, straight at rest, on a frictionless table. Planner and
    controllers know a cable only as its `rod`; all else is the simulated plant's.

    Values along the length stand at equal arc length from the left to the right grasp, ends included, and are
    interpolated linearly; a single one holds everywhere.

    Attributes:
        length: Between the two grasps [m].
        radius: [m].
        keypoints: Number n of points at equal arc length, both ends included.
        bending_stiffness: EI [N m^2].
        stiffness_profile: Factors on EI along the length.
        rest_curvature: Curvature [1/m] along the length of the cable under no load; positive turns left.
        yield_curvature: Change of curvature [1/m] from that at rest beyond which the cable keeps a set; 0 for never.
        damping_time: tau [s]: bending damping over bending stiffness, how the shape lags.
        linear_density: [kg/m].
        friction: Coulomb coefficient on the table.
        drag: Force per length and speed that resists any motion of the cable [N s/m^2].
        min_bend_radius: Smallest radius of curvature the cable may take [m]; 0 for none.
        preset: Name of the preset the values come from, for the record.

    Raises:
        TaskError: A value is not finite or out of range.
    """

    length: Annotated[float, "a length", checks.LENGTH] = 0.3
    radius: Annotated[float, "a length", Quantity("m", 5e-5, 0.1)] = 0.004
    keypoints: Annotated[int, "a whole number"] = 13
    bending_stiffness: Annotated[float, "a number in N m^2", Quantity("N m^2", 1e-8, 1e3)] = 1e-3
    stiffness_profile: Annotated[tuple[float, ...], "a list of factors", 1] = (1.0,)
    rest_curvature: Annotated[tuple[Curvature, ...], "a list of numbers", 1] = (0.0,)
    yield_curvature: Annotated[float, "a number", Quantity("1/m", 0.0, 1e5)] = 0.0
    damping_time: Annotated[float, "a number in seconds", Quantity("s", 1e-3, 1e2)] = 0.1
    linear_density: Annotated[float, "a number in kg/m", Quantity("kg/m", 1e-5, 1e2)] = 0.03
    friction: Annotated[float, "a Coulomb coefficient", Quantity("", 0.0, 10.0)] = 0.0
    drag: Annotated[float, "a number in N s/m^2", Quantity("N s/m^2", 0.0, 1e3)] = 0.0
    min_bend_radius: Annotated[float, "a length", Quantity("m", 0.0, 10.0)] = 0.0
    preset: Annotated[str | None, "the name of a preset"] = None

    def __post_init__(self) -> None:
        checks.check_quantities(self, "cable")
        for name, quantity in PROFILES.items():
            values = checks.profile(getattr(self, name), ("cable", name), MOST_VALUES, quantity)
            object.__setattr__(self, name, values)
        object.__setattr__(self, "keypoints", checks.integer(self.keypoints, ("cable", "keypoints"), *KEYPOINTS))
        if self.radius * 4 > self.length:
            raise TaskError(
                f"is {limit_text(self.radius)}, too thick for a length of {limit_text(self.length)}: at most a "
                "quarter of it",
                ("cable", "radius"),
            )
        tightest = 2 * np.pi * MOST_TURNS / self.length
        for i, value in enumerate(self.rest_curvature):
            if abs(value) > tightest:
                raise TaskError(
                    f"must be at most {MOST_TURNS:g} full turns, {tightest:.4g} 1/m, either way, got {value!r} 1/m",
                    ("cable", "rest_curvature", i),
                )

    @property
    def rod(self) -> PlanarRod:
        """The uniform elastic rod that stands for the cable in planning."""
        return PlanarRod(self.length, self.keypoints)

    def estimated(self, length: float, modes: tuple[float, ...]) -> EstimatedCable:
        """The same cable, of another length [m], that bends as modes of `PlanarRod` have it."""
        return EstimatedCable(**{**Cable.as_dict(self), "length": length, "modes": modes})

    @property
    def frequency(self) -> float:
        """Of the first bending mode [Hz], straight and clamped at both ends: 4.730^2 / (2 pi L^2) sqrt(EI / rho)."""
        return (
            FIRST_MODE**2 / (2 * np.pi * self.length**2) * float(np.sqrt(self.bending_stiffness / self.linear_density))
        )

    @property
    def swing_period(self) -> float:
        """Of the first bending mode [s] of a cable that swings about its equilibria, at most `LONGEST_SWING`; 0 for one
        that does not.
        """
        return min(1 / self.frequency, LONGEST_SWING) if self.frequency < QUASI_STATIC else 0.0

    def friction_number(self, friction: float) -> float:
        """mu rho g L^3 / EI: the friction over the length, against what bends the cable to that size.

        Args:
            friction: mu, Coulomb coefficient on the table.
        """
        return friction * self.linear_density * GRAVITY * self.length**3 / self.bending_stiffness

    @property
    def bends_as_rod(self) -> bool:
        """Whether the equilibria of `rod` are the cable's, too.

        A rest curvature that is the same everywhere changes nothing between clamped ends: it adds to the energy the
        turn between them, which is given.
        """
        return not self.yield_curvature and all(len(set(getattr(self, name))) == 1 for name in PROFILES)

    def along(self, name: str, positions: Float[np.ndarray, "k"]) -> Float[np.ndarray, "k"]:
        """Values of `stiffness_profile` or `rest_curvature` at shares (k,) of the length from the left grasp."""
        values = getattr(self, name)
        return np.interp(positions, np.linspace(0, 1, len(values)), values)

    def sample(self, seed: Seed, ranges: Mapping[str, tuple[float, float]] | None = None) -> Cable:
        """A cable of this kind: some fields drawn at random, the others as they are.

        >>> 3e-3 <= Cable(preset="usb").sample(seed=0).bending_stiffness <= 1e-2
        True

        Args:
            seed: Same seed, same cable.
            ranges: Least and greatest value of each field to draw; those of the cable's preset where None.

        Raises:
            InputError: There are no ranges, or one is not of a field or not two ascending numbers.
            TaskError: A value drawn is one that no cable can have.
        """
        if ranges is None and self.preset not in preset_names():
            raise InputError(
                f"preset {self.preset!r} has no ranges to draw from; give `ranges`, "
                f"or use one of the presets {', '.join(preset_names())}"
            )
        rng = np.random.default_rng(seed)
        wanted = preset_ranges(str(self.preset)) if ranges is None else ranges
        return replace(self, **{name: _drawn(name, wanted[name], rng) for name in sorted(wanted)})

    def as_dict(self) -> dict[str, Any]:
        """All fields by name."""
        return {field.name: getattr(self, field.name) for field in fields(self)}


@dataclass(frozen=True, kw_only=True)
class EstimatedCable(Cable):
    """A cable as it turned out to be while it was led, for plans that go on from there.

    Attributes:
        modes: Of `PlanarRod`: how the rod that stands for it differs from a uniform one.

    Raises:
        TaskError: As for `Cable`.
    """

    modes: tuple[float, ...]

    @property
    def rod(self) -> PlanarRod:
        """The rod that stands for the cable in planning."""
        return PlanarRod(self.length, self.keypoints, self.modes)


_DRAWABLE = tuple(field.name for field in fields(Cable) if field.name not in ("keypoints", "preset"))


def _drawn(name: str, limits: tuple[float, float], rng: np.random.Generator) -> float | tuple[float, ...]:
    if name not in _DRAWABLE:
        raise InputError(f"there is no range for {name!r}; known: {', '.join(_DRAWABLE)}")
    quantity = PROFILES.get(name) or checks.quantities(Cable)[name]
    low, high = checks.pair(limits, ("ranges", name), quantity)
    if low > high:
        raise InputError(f"ranges.{name} must be two ascending numbers, got {limits!r}")
    count = DRAWN_VALUES if name in PROFILES else 1
    if name in LOGARITHMIC:
        values = np.exp(rng.uniform(np.log(low), np.log(high), count))
    else:
        values = rng.uniform(low, high, count)
    drawn = tuple(np.clip(values, low, high).tolist())
    return drawn if name in PROFILES else drawn[0]
