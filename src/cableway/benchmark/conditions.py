"""Conditions of the suite "eyes": where cameras stand, what their pictures are like, and what else is in them."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

from cableway.core.errors import UnknownNameError
from cableway.perception.markers import Tracker
from cableway.tracking.photographer import EyesConfig

FRAME_RATE = 10.0
"""Pictures a second [Hz], one for each control step: harder for a tracker than 30, and a third of the rendering."""


@dataclass(frozen=True)
class Condition:
    """A condition.

    Attributes:
        name: Its name.
        description: What differs, in a few words.
        eyes: The cameras.
    """

    name: str
    description: str
    eyes: EyesConfig = field(default_factory=EyesConfig)

    def seen(self, seed: int, tracker: Tracker = "rod") -> EyesConfig:
        """The cameras of an episode, and what finds the cable in their pictures."""
        return replace(self.eyes, frame_rate=FRAME_RATE, seed=seed, tracker=tracker)


CONDITIONS = {
    condition.name: condition
    for condition in (
        Condition("two-low", "two low cameras, at front and back"),
        Condition("above", "one camera, straight above", EyesConfig(cameras=("above",))),
        Condition("second-cable", "a second cable of this colour across the table", EyesConfig(strangers=("cable",))),
        Condition("dim", "half of the light", EyesConfig(exposure=0.5)),
        Condition("person", "a person's arm over the table for 2 s of every 6", EyesConfig(strangers=("arm",))),
        Condition("front", "one low camera, at the front", EyesConfig(cameras=("front",))),
        Condition("glaring", "half as much light again, white cut off", EyesConfig(exposure=1.5)),
        Condition("two-sides", "two low cameras, at left and right", EyesConfig(cameras=("left", "right"))),
        Condition("shadows", "hard shadows, little light but the lamp's", EyesConfig(shadows=True, ambient=0.35)),
        Condition("blurred", "blur of 2 pixels", EyesConfig(blur=2.0)),
        Condition("noisy", "noise of 20 of 255", EyesConfig(noise=20.0)),
        Condition("faded", "a cable paler than what is looked for", EyesConfig(tint=(0.80, 0.42, 0.17))),
        Condition("alike", "posts, boxes and grippers of the cable's colour", EyesConfig(alike=True)),
        Condition("losing", "one picture in five lost, latency 0.15 s", EyesConfig(drop_rate=0.2, latency=0.15)),
    )
}  # fmt: skip
"""By name; all with the two low cameras, blur of 0.7 pixels, noise of 5 and latency of 50 ms unless stated."""


def condition_of(name: str) -> Condition:
    """The condition of a name.

    Raises:
        UnknownNameError: There is none; the message lists them.
    """
    if name not in CONDITIONS:
        raise UnknownNameError("condition", name, CONDITIONS)
    return CONDITIONS[name]
