"""Pictures are cut to what they show."""

import numpy as np

from pipeline.reporting.scene_still import cropped


def test_background_is_cut_away():
    """All that differs from the background stays, with ten pixels around it; an empty picture stays as it is."""
    image = np.full((200, 300, 3), 255, np.uint8)
    assert cropped(image).shape == image.shape
    image[50:60, 100:150] = 0
    assert cropped(image).shape == (30, 70, 3)
    assert (cropped(image) == 0).all(axis=2).sum() == 10 * 50
    image[0, 299] = 7  # at a corner there is no more background
    assert cropped(image).shape == (70, 210, 3)
