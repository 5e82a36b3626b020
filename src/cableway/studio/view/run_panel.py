"""The panel of a run: which controller in which plant, how far it is, and what is known of it."""

from __future__ import annotations

import numpy as np
import viser
from jaxtyping import UInt8

from cableway.core.quantities import quantity
from cableway.figures import palette
from cableway.studio.running import CAMERAS, PLANTS, SPATIAL_PLANTS, Running, Wanted
from cableway.studio.view import look
from cableway.studio.view.events import in_order
from cableway.studio.view.panel import LOUD, Do, plot, set_changed
from cableway.workflow.registry import CONTROLLERS
from cableway.workflow.spatial_run import CONTROLLERS as SPATIAL_CONTROLLERS

NO_RUN = "Once there is a plan, it can be run here, by a controller in a plant that is not what was planned for."
PUSH = "Drag an obstacle while it runs to push it into the way, once."

CHOICES = {False: (tuple(CONTROLLERS), PLANTS), True: (tuple(SPATIAL_CONTROLLERS), SPATIAL_PLANTS)}
"""Controllers and plants on the table and in space."""

NO_PICTURE = np.zeros((8, 8, 3), np.uint8)

COLORS = {True: palette.BLUE, False: palette.MUTED}
"""Of what is said while a run goes on, and afterwards."""


class RunPanel:
    """Which run, and what is seen of it.

    Args:
        gui: The page's controls.
        do: Posts what is to be done.
        begin: Begins a run, or ends the one under way.
        scrub: Shows a row of it.
        export: Hands a page that plays it to the browser.
        film: The same with a video.
    """

    def __init__(self, gui: viser.GuiApi, do: Do, begin: Do, scrub: Do, export: Do, film: Do) -> None:
        self.said = gui.add_html(look.hint(NO_RUN))
        self._controller = gui.add_dropdown("Controller", tuple(CONTROLLERS))
        self._plant = gui.add_dropdown("Plant", PLANTS)
        self._stiffness = gui.add_slider("Stiffness [%]", 25, 400, 5, 100)
        self._length = gui.add_slider("Length [%]", 95.0, 105.0, 0.5, 100.0)
        of_plant = "0: as the plant has it"
        self._friction = gui.add_slider("Friction", 0.0, 1.0, 0.05, 0.0, hint=of_plant)
        self._noise = gui.add_slider("Noise [mm]", 0.0, 5.0, 0.5, 0.0, hint=of_plant)
        self._delay = gui.add_slider("Delay [s]", 0.0, 0.3, 0.1, 0.0, hint=of_plant)
        by = "Pictures by which alone the controller knows the cable; with none, the plant tells it where keypoints are"
        self._cameras = gui.add_dropdown("Cameras", tuple(CAMERAS), hint=by)
        self._choices = (
            self._controller, self._plant, self._stiffness, self._length, self._friction, self._noise, self._delay
        )  # fmt: skip
        self.start = gui.add_button("Run", icon=viser.Icon.PLAYER_PLAY, color=LOUD)
        self.start.on_click(in_order(lambda _: do(begin)))
        self.step = gui.add_slider("Step of the run", 0, 1, 1, 0, visible=False)
        self.step.on_update(lambda event: event.client and do(lambda: scrub(self.step.value), key="scrub run"))
        self.now = gui.add_html("")
        seen = (
            ("true cable", palette.INK),
            ("where it should be", palette.REFERENCE),
            ("as it is seen", palette.GREEN),
        )
        self._key = gui.add_html(look.legend("Shown", seen))
        self._picture = gui.add_image(NO_PICTURE, label="What the cameras see", format="jpeg", visible=False)
        self._clear = plot(gui, "Clearance [mm]", (("cable", palette.INK), ("grippers", palette.RIGHT)))
        self._export = gui.add_button(
            "Download a page that plays the run", visible=False, color=look.rgb(palette.MUTED)
        )
        self._export.on_click(in_order(lambda _: do(export)))
        self._film = gui.add_button("Make a video of the run", visible=False, color=look.rgb(palette.MUTED))
        self._film.on_click(in_order(lambda _: do(film)))
        self._drawn = 0

    @property
    def wanted(self) -> Wanted:
        """What is chosen."""
        return Wanted(
            controller=self._controller.value,
            plant=self._plant.value,
            stiffness=self._stiffness.value / 100,
            length=self._length.value / 100,
            friction=self._friction.value or None,
            noise=self._noise.value / 1000 or None,
            delay=self._delay.value or None,
            cameras=CAMERAS[self._cameras.value],
        )

    def show(
        self, running: Running | None, row: int, can_run: bool, *, in_space: bool = False, watched: bool = False
    ) -> None:
        """Show how far a run is, and one row of it; where it is only watched, nothing is chosen, stopped or pushed."""
        for field, options in ((self._controller, CHOICES[in_space][0]), (self._plant, CHOICES[in_space][1])):
            if tuple(field.options) != options:
                field.options = options
        for field in self._choices:
            set_changed(field, "visible", not watched)
        set_changed(self._cameras, "visible", not (in_space or watched))
        live, rows = running is not None and running.live, () if running is None else running.seen
        if running is None:
            set_changed(self.said, "content", look.hint(NO_RUN))
        else:
            told = [running.sentence, *([PUSH] if live and rows and not (running.kept or watched) else [])]
            set_changed(self.said, "content", look.sentences(told, _color(running)))
        set_changed(self.start, "label", "Stop" if live else "Run")
        set_changed(self.start, "disabled", watched or not (live or can_run))
        for field in (self.step, self.now, self._key, *self._clear):
            set_changed(field, "visible", len(rows) > 1)
        made = running is not None and running.rollout is not None and len(rows) > 1
        set_changed(self._export, "visible", made)
        set_changed(self._film, "visible", made)
        if len(rows) < 2:
            self._drawn = 0
            return
        set_changed(self.step, "max", len(rows) - 1)
        set_changed(self.step, "value", row)
        if len(rows) // 5 != self._drawn // 5 or not live:  # a curve that grows by every step would be drawn too often
            self._drawn = len(rows)
            clear = np.array([(each.measured.clearance, each.measured.gripper_clearance) for each in rows])
            self._clear[1].data = (np.array([each.time for each in rows]), *(1000 * clear.T))
        set_changed(self.now, "content", look.hint(_told(running, row)))

    def show_picture(self, picture: UInt8[np.ndarray, "h w 3"] | None) -> None:
        """Show what cameras see; nothing where there are none."""
        set_changed(self._picture, "visible", picture is not None)
        if picture is not None:
            self._picture.image = picture


def _told(running: Running | None, row: int) -> str:
    assert running is not None
    here = running.seen[row]
    found = "; ".join(f"{name} {each}" for name, each in here.estimates.items() if each.differs)
    known = f" Found to differ: {found or 'nothing'}." if here.estimates else ""
    return (
        f"{here.time:.1f} s, {here.status or 'start'}: cable {quantity(here.measured.clearance)} clear, grippers "
        f"{quantity(here.measured.gripper_clearance)}.{known}"
    )


def _color(running: Running) -> str:
    if running.run is None:
        return COLORS[running.live]
    return palette.GREEN if running.run.success else palette.BAD
