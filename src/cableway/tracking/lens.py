"""Pictures through a lens that distorts, from pictures of a pinhole camera that sees a little more."""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property

import numpy as np
from jaxtyping import Float
from scipy.ndimage import map_coordinates

from cableway.perception.calibration import NONE, CalibratedCamera
from cableway.rendering.camera import Camera


class Lens:
    """The lens of a camera.

    Args:
        camera: The camera.
    """

    def __init__(self, camera: CalibratedCamera) -> None:
        self.camera = camera

    @cached_property
    def _at(self) -> Float[np.ndarray, "h w 2"]:
        """Where in a pinhole camera's picture (u, v) the rays of the pixels are [pixels]; NaN where no ray is."""
        pinhole = self.camera.pinhole
        width, height = pinhole.size
        pixels = np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1)
        return self.camera.rays(pixels) * pinhole.focal + pinhole.center

    @cached_property
    def _margin(self) -> tuple[int, int]:
        """Pixels to each side by which what is seen reaches beyond the picture of a pinhole camera."""
        at, last = self._at, np.array(self.camera.pinhole.size) - 1
        most = np.maximum(np.nanmax(at, axis=(0, 1)) - last, -np.nanmin(at, axis=(0, 1)))
        right, down = np.clip(np.ceil(most), 0, last)
        return int(right), int(down)

    @cached_property
    def pinhole(self) -> Camera:
        """A camera without distortion that sees all that this one does."""
        pinhole = self.camera.pinhole
        if self.camera.distortion == NONE:
            return pinhole
        (right, down), (width, height), (u, v) = self._margin, pinhole.size, pinhole.center
        return replace(pinhole, size=(width + 2 * right, height + 2 * down), center=(u + right, v + down))

    def nearest(self, picture: np.ndarray) -> np.ndarray:
        """As `through`, but of the nearest pixel whatever the numbers are: depths at an edge are none between."""
        return self._mapped(picture, 0)

    def through(self, picture: np.ndarray) -> np.ndarray:
        """What `pinhole` shows (h, w) or (h, w, channels) as this lens shows it: whole numbers are those of the nearest
        pixel, others between them; outside of what it shows it is the edge."""
        return self._mapped(picture, 0 if picture.dtype.kind in "iub" else 1)

    def _mapped(self, picture: np.ndarray, order: int) -> np.ndarray:
        if self.camera.distortion == NONE:
            return picture
        u, v = np.moveaxis(np.nan_to_num(self._at + self._margin, nan=-1.0), -1, 0)
        layers = picture[..., None] if picture.ndim == 2 else picture
        layers = layers.astype(np.uint8) if picture.dtype == bool else layers
        mapped = [map_coordinates(layer, [v, u], order=order, mode="nearest") for layer in np.moveaxis(layers, -1, 0)]
        return np.stack(mapped, axis=-1).reshape(*u.shape, *picture.shape[2:]).astype(picture.dtype)
