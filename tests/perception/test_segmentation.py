"""Laws of masks by colour: what is nearer to the cable than to the background, in light and shade, sharp or blurred."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from cableway.core.errors import InputError
from cableway.perception.segmentation import CableColor, cable_mask, changed

ORANGE = CableColor(color=(217, 89, 13))


def band(background: tuple[int, int, int], blur: float, width: int = 6) -> np.ndarray:
    """A picture of a band of orange across, `width` pixels wide."""
    image = np.empty((60, 80, 3))
    image[:], image[30 : 30 + width] = background, ORANGE.color
    return gaussian_filter(image, (blur, 0, 0)).round().astype(np.uint8)


@pytest.mark.parametrize("blur", [0.0, 1.0, 2.0])
@pytest.mark.parametrize(("light", "least"), [(0.4, 4), (1.0, 6)])
def test_a_blurred_band_is_as_wide_as_a_sharp_one(blur: float, light: float, least: int):
    image = (light * band((224, 224, 224), blur)).astype(np.uint8)
    wide = cable_mask(image, ORANGE).sum(axis=0)
    assert wide.min() >= least
    assert wide.max() <= 6


def test_a_background_of_nearly_its_colour_is_none_of_it():
    """Wood is only 0.45 rad away, and something 0.3 rad away is the cable's on a grey table alone."""
    mask = cable_mask(band((200, 160, 110), 0.0), ORANGE)
    assert mask[30:36].all()
    assert mask.sum() == 6 * 80
    pale = (217, 125, 70)
    image = band((224, 224, 224), 0.0)
    image[10] = pale
    assert cable_mask(image, ORANGE)[10].all()
    image[:30], image[36:] = (200, 160, 110), (200, 160, 110)
    image[10] = pale
    assert not cable_mask(image, ORANGE)[10].any()


def test_a_black_picture_has_no_cable():
    assert not cable_mask(np.zeros((60, 80, 3), np.uint8), ORANGE).any()


def test_a_grey_cable_on_a_grey_table_is_what_has_changed():
    rng = np.random.default_rng(0)
    empty = np.full((60, 80, 3), 120.0) + 5 * rng.standard_normal((60, 80, 3))
    image = empty + 5 * rng.standard_normal(empty.shape)
    image[20:26] += 45.0
    found = changed(*(np.clip(each, 0, 255).astype(np.uint8) for each in (1.2 * image, empty)))
    assert found[20:26].mean() > 0.95
    assert np.delete(found, slice(20, 26), axis=0).mean() < 0.01


def test_a_background_of_another_size_is_refused():
    with pytest.raises(InputError, match="must be of one size, got 8 x 6 and 6 x 8 pixels"):
        changed(np.zeros((6, 8, 3), np.uint8), np.zeros((8, 6, 3), np.uint8))
