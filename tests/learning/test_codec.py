"""The codec: what a network is given says all of a configuration, and an angle as the same angle a turn later."""

from dataclasses import replace

import numpy as np
import pytest
from small_training import LIMITS

from pipeline.errors import ConfigError
from pipeline.learning.codec import Codec

CRANE = Codec((-np.inf, -1.0, -np.inf, 0.2), (np.inf, 3.0, np.inf, 0.4), (True, False, True, False), centre=True)


def test_limits():
    """Limits map to +-0.5 with centring, and to limit over range without."""
    Q = np.array([LIMITS.lower, LIMITS.upper])
    np.testing.assert_allclose(LIMITS.encode(Q), [[-0.5, -0.4, 0.5], [0.5, 0.6, 1.5]])
    np.testing.assert_allclose(replace(LIMITS, centre=True).encode(Q), [[-0.5] * 3, [0.5] * 3])


def test_numbers_by_hand():
    """A joint that turns takes two numbers in its place, half its cosine and half its sine; what is wider is 0."""
    found = CRANE.encode(np.array([[np.pi / 3, 3.0, -np.pi / 2, 0.3]]), 8)
    expected = [0.25, np.sqrt(3) / 4, 0.5, 0.0, -0.5, 0.0, 0.0, 0.0]
    assert CRANE.size == 6 and CRANE.dimension == 4
    np.testing.assert_allclose(found, [expected], atol=1e-12)


@pytest.mark.parametrize("codec", [LIMITS, replace(LIMITS, centre=True), CRANE])
def test_there_and_back(codec):
    """Decoded numbers are the configuration, whatever the width."""
    rng = np.random.default_rng(0)
    low, high = (np.where(codec.turning, sign * 3.1, bound) for sign, bound in ((-1, codec.lower), (1, codec.upper)))
    Q = rng.uniform(low, high, (50, codec.dimension))
    for width in (0, 11):
        np.testing.assert_allclose(codec.decode(codec.encode(Q, width)), Q, rtol=1e-12)


def test_a_turn_later():
    """Whole turns change no number of a joint that turns, and numbers of near angles are near, also across pi."""
    Q = np.array([[3.14, 0.5, -1.0, 0.3]])
    np.testing.assert_allclose(CRANE.encode(Q + np.array([2 * np.pi, 0, -4 * np.pi, 0])), CRANE.encode(Q), atol=1e-12)
    across = CRANE.encode(np.array([[-3.14, 0.5, -1.0, 0.3]]))
    assert np.abs(across - CRANE.encode(Q)).max() < 0.002


def test_any_pair_is_an_angle():
    """A network's cosine and sine need not be of one: the angle is where they point, in (-pi, pi]."""
    X = np.array([[0.1, 0.1, 0.0, -3.0, 0.0, 0.0]])
    np.testing.assert_allclose(CRANE.decode(X)[0, [0, 2]], [np.pi / 4, np.pi])


def test_limits_of_several_robots(crane_like):
    """The codec of robots of the same joints reaches from the lowest to the highest of their limits."""
    one, other = crane_like(-1.0, 0.5), crane_like(-0.5, 2.0)
    codec = Codec.of([one, other], centre=False)
    assert (codec.lower[0], codec.upper[0]) == (-1.0, 2.0)


@pytest.mark.parametrize("limits", [((0.0, 1.0), (1.0, 1.0)), ((0.0,), (np.inf,)), ((np.nan,), (1.0,))])
def test_refused(limits):
    """What has no range cannot be scaled by it."""
    with pytest.raises(ConfigError, match="lower below upper"):
        Codec(*limits)
