"""Pictures one after the other, encoded as a film."""

from __future__ import annotations

import shutil
import subprocess
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from itertools import chain
from pathlib import Path

import imageio_ffmpeg
import numpy as np

from cableway.core.errors import CablewayError
from cableway.core.files import write_atomically

PIXELS = {3: "rgb24", 4: "rgba"}
"""ffmpeg's names of pixels, by the number of their bytes."""


def write_film(path: Path, rate: float, frames: Iterable[np.ndarray]) -> None:
    """Write a film (MP4, H.264); one of no frames is none, and no file.

    Args:
        path: Where to; written atomically.
        rate: Frames per second.
        frames: (height, width, 3 or 4) of 8-bit colours, all as large; an odd row or column at the end is repeated.

    Raises:
        CablewayError: The encoder failed.
    """
    rest = iter(frames)
    first = next(rest, None)
    if first is None:
        return
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=path.parent, prefix=f".{path.name}.") as folder:
        film = Path(folder) / "film.mp4"
        try:
            _encode(film, rate, first.shape, chain([first], rest))
        except (OSError, RuntimeError) as error:
            raise CablewayError(f"{path}: the video could not be encoded ({error})") from error
        with film.open("rb") as source:
            write_atomically(path, lambda file: shutil.copyfileobj(source, file))


def beside(pictures: Sequence[np.ndarray]) -> np.ndarray:
    """Pictures (h, w, 3) in a row, with black below lower ones.

    >>> beside([np.zeros((2, 3, 3), np.uint8), np.zeros((4, 5, 3), np.uint8)]).shape
    (4, 8, 3)
    """
    tallest = max(len(each) for each in pictures)
    return np.hstack([np.pad(each, ((0, tallest - len(each)), (0, 0), (0, 0))) for each in pictures])


def _encode(path: Path, rate: float, shape: tuple[int, ...], frames: Iterator[np.ndarray]) -> None:
    """Send frames of a shape to ffmpeg.

    Its process is started here and not by imageio-ffmpeg, which forks to do so: a risk where JAX's threads run.
    A group of its own keeps ctrl-c from it.
    """
    height, width, count = shape
    odd = (height % 2, width % 2)
    size = f"{width + odd[1]}x{height + odd[0]}"
    raw = ["-f", "rawvideo", "-pix_fmt", PIXELS[count], "-s", size, "-r", f"{rate:.6g}", "-i", "-"]
    coded = ["-an", "-vcodec", "libx264", "-pix_fmt", "yuv420p", "-preset", "veryfast", "-crf", "19"]
    command = [imageio_ffmpeg.get_ffmpeg_exe(), "-v", "error", *raw, *coded, "-movflags", "+faststart", str(path)]
    with subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, process_group=0
    ) as encoder:
        assert encoder.stdin is not None
        assert encoder.stderr is not None
        try:
            with encoder.stdin as sink:
                for frame in frames:
                    if any(odd):  # H.264 halves the resolution of colours
                        frame = np.pad(frame, [(0, odd[0]), (0, odd[1]), (0, 0)], mode="edge")
                    sink.write(np.ascontiguousarray(frame).data)
        except BrokenPipeError:
            pass  # ffmpeg gave up; it says why
        except BaseException:
            encoder.kill()
            encoder.wait()  # `with` alone does not wait after an interrupt
            raise
        complaint = encoder.stderr.read().decode(errors="replace").strip()
    if encoder.returncode != 0:
        raise OSError(complaint.splitlines()[-1] if complaint else f"ffmpeg ended with {encoder.returncode}")
