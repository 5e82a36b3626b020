"""`cableway see`: keypoints of a cable in pictures."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from itertools import takewhile
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from cableway.cli.options import Maybe, Options, option
from cableway.cli.terminal import Terminal, pairs
from cableway.core.errors import InputError, UnknownNameError

if TYPE_CHECKING:
    import numpy as np

    from cableway.workflow.seeing import Eye

KEYPOINTS, OVERLAY = "keypoints.csv", "overlay.mp4"
"""What it leaves."""

MOST_PORT = 65535

HIDDEN = ("stands", "free")
"""What may be made of parts of the table that no camera saw."""


@dataclass(frozen=True, kw_only=True)
class See(Options):
    """Find a cable in pictures: keypoints.csv, a recording, and overlay.mp4. With --depth, what stands on the table:
    seen.yaml, a task, and seen.png. Needs pip install 'cableway[vision]'."""

    source: Annotated[tyro.conf.Positional[str], tyro.conf.arg(metavar="SOURCE")]
    """A video file, a folder of pictures, the number of a camera, realsense or realsense:SERIAL, or a recording of one
    (.bag, .db3; extra realsense); with --depth, a picture, too; of several cameras, separated by commas."""

    calibration: Annotated[str, tyro.conf.arg(metavar="CAMERA.json")]
    """The camera, as `calibrate` writes it; of several cameras in the order of their sources, separated by commas."""

    color: Annotated[str, tyro.conf.arg(metavar="R,G,B")]
    """Colour of the cable in the pictures, from 0 to 255; with --tracker markers, that of the markers."""

    cable_color: Annotated[str | None, option(metavar="R,G,B")] = None
    """With --tracker markers: colour of the cable between them, so that its own pixels count, too; by default, they do
    not."""

    hides: Annotated[str | None, option(metavar="MASK.png")] = None
    """What may hide the cable, such as arms: for each camera a picture that is black where nothing does, or a video
    file or a folder with one for each of its pictures. By default, that is not known, and a table seen where the cable
    should be does not count against what was found."""

    background: Annotated[str | None, option(metavar="EMPTY.png")] = None
    """The same place without the cable, a picture for each camera: what is in it is not the cable, whatever its colour.
    By default, all of this colour may be."""

    task: Maybe[str] = None
    """A task with this cable; by default, a cable of 0.3 m with 13 keypoints. With --depth, a task on this table: what
    is found takes the place of its obstacles."""

    depth: Annotated[str | None, option(metavar="DEPTH.png")] = None
    """Find what stands on the table, by depths in the pixels of SOURCE: for each camera a picture of 16 bits in
    millimetres, a folder of such pictures of a table on which nothing moves, or a RealSense camera or recording; by
    default, the cable is found."""

    hidden: Annotated[str, tyro.conf.arg(metavar="{stands,free}")] = "stands"
    """With --depth: whether parts of the table that no camera saw are obstacles, or free."""

    grippers: Annotated[Path | None, option(metavar="FILE.csv")] = None
    """Gripper poses by time, with the columns of a recording, for what is hidden to be found, too; by default, only
    what is seen is found."""

    tracker: Annotated[str, tyro.conf.arg(metavar="{rod,markers}")] = "rod"
    """What finds the cable with --grippers: its own pixels, or markers at its keypoints but for the ends."""

    rate: float = 30.0
    """Pictures per second, where the source does not say."""

    seconds: Maybe[float] = None
    """When to stop; by default, at the end of the source, or Ctrl-C."""

    live: Annotated[int | None, option(metavar="PORT")] = None
    """Show the pictures with what was found in them, as they are taken, on a page of this machine at this port, 0 for
    any; by default, nowhere."""

    seed: tyro.conf.Suppress[None] = None
    """Nothing is drawn."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if not 0 < self.rate <= 1000:
            raise InputError(f"--rate must be above 0 and at most 1000, got {self.rate}")
        if self.seconds is not None and not self.seconds > 0:
            raise InputError(f"--seconds must be above 0, got {self.seconds}")
        if self.live is not None and not 0 <= self.live <= MOST_PORT:
            raise InputError(f"--live must be a port, from 0 to {MOST_PORT}, got {self.live}")
        if self.tracker == "markers" and self.grippers is None:
            raise InputError("--tracker markers needs --grippers: the rod between them says which marker is which")
        if self.cable_color is not None and self.tracker != "markers":
            raise InputError("--cable-color needs --tracker markers; without, --color is that of the cable")
        self._check_depth()
        count = len(self.source.split(","))
        for name in ("calibration", "hides", "background", "depth"):
            given = getattr(self, name)
            if given is not None and len(given.split(",")) != count:
                raise InputError(f"--{name} must be one for each of {count} sources, got {given}")

    def _check_depth(self) -> None:
        """Whether the options are of one kind.

        Raises:
            InputError: They are not.
        """
        if self.hidden not in HIDDEN:
            raise UnknownNameError("value of --hidden", self.hidden, HIDDEN)
        if self.depth is None:
            if self.hidden != "stands":
                raise InputError("--hidden: only goes with --depth")
            return
        if self.task is None:
            raise InputError("--depth needs --task: the task whose obstacles are to be those on the table")
        for name in ("background", "grippers", "tracker", "rate", "seconds", "live"):
            if getattr(self, name) != getattr(type(self), name):
                raise InputError(f"--{name}: does not go with --depth, by which no cable is followed")

    def execute(self) -> int:
        """Carry the command out and return its exit status."""
        if self.depth is not None:
            from cableway.cli.see_scene import see_scene

            return see_scene(self, _rgb("--color", self.color))
        import numpy as np

        from cableway.core.files import only_writer
        from cableway.figures.film import beside, write_film
        from cableway.perception.capture import marked
        from cableway.perception.live import LiveView
        from cableway.perception.segmentation import CableColor
        from cableway.scene.cable import Cable
        from cableway.scene.files.loading import load_planar_task
        from cableway.workflow.seeing import GripperLog, Seen, see, write_recording

        color = CableColor(color=_rgb("--color", self.color))
        between = None if self.cable_color is None else CableColor(color=_rgb("--cable-color", self.cable_color))
        cable = Cable() if self.task is None else load_planar_task(self.task).cable
        grippers = None if self.grippers is None else GripperLog.load(self.grippers)
        folder, terminal, found = self.folder("see"), Terminal(self), list[Seen]()
        eyes, rate = self._eyes()

        def overlaid(view: LiveView | None) -> Iterator[np.ndarray]:
            """Pictures with what was found in them, noted in `found`; until Ctrl-C."""
            try:
                for seen in see(eyes, color, cable, grippers, 1 / rate, self.tracker, between):
                    at = np.hstack([seen.keypoints, np.full((len(seen.keypoints), 1), cable.radius)])
                    found.append(seen.without_picture())
                    shown = zip(eyes, seen.images, strict=True)
                    picture = beside([marked(image, eye.camera.project(at)[0]) for eye, image in shown])
                    if view is not None:
                        view.show(picture)
                    yield picture
            except KeyboardInterrupt:
                if not found:
                    raise

        with only_writer(folder), ExitStack() as stack:
            view = None if self.live is None else stack.enter_context(LiveView(self.live))
            if view is not None:
                terminal.note(f"The pictures are at {view.address}")
            write_film(folder / OVERLAY, rate, overlaid(view))
            write_recording(folder / KEYPOINTS, found)
        known = sum(each.known for each in found)
        report = {"pictures": len(found), "known": known, "seconds": found[-1].time, "folder": str(folder)}
        self.keep("see", report)
        rows = [
            ("pictures", f"{len(found)}, the cable found in {known}"),
            ("files", f"{folder / KEYPOINTS}, {OVERLAY}"),
        ]
        terminal.result(report, pairs(rows))
        return 0 if known else 1

    def _eyes(self) -> tuple[list[Eye], float]:
        """The cameras, and their pictures per second.

        Raises:
            CablewayError: A file or a source cannot be read.
            InputError: The sources have different numbers of pictures per second.
        """
        from cableway.perception.calibration_file import load_camera
        from cableway.perception.capture import frames, picture, rate_of
        from cableway.workflow.seeing import Eye, masks

        sources, eyes = self.source.split(","), list[Eye]()
        rates = [rate_of(source, self.rate) for source in sources]
        if len(set(rates)) > 1:
            shown = " and ".join(f"{rate:g}" for rate in rates)
            raise InputError(f"SOURCE: all cameras must take as many pictures per second, got {shown} in {self.source}")
        nothing, most = ",".join([""] * len(sources)), self.seconds
        given = [(each or nothing).split(",") for each in (self.calibration, self.hides, self.background)]
        for source, calibration, hiding, empty in zip(sources, *given, strict=True):
            camera, pictures = load_camera(calibration), frames(source, rates[0])
            if most is not None:
                pictures = takewhile(lambda frame: frame.time <= most, pictures)
            hides = masks(hiding, rates[0]) if hiding else None
            eyes.append(Eye(camera, pictures, hides, picture(Path(empty)) if empty else None))
        return eyes, rates[0]


def _rgb(name: str, given: str) -> tuple[float, float, float]:
    """Red, green and blue of an option.

    Raises:
        InputError: They are not three numbers.
    """
    try:
        red, green, blue = (float(part) for part in given.split(","))
    except ValueError:
        raise InputError(f"{name} must be three numbers R,G,B from 0 to 255, got {given!r}") from None
    return red, green, blue
