"""Many configurations asked at once get the verdict that one by one they would get."""

import numpy as np
import pytest

from pipeline.robots import Obstacle, Shape, Validity
from tests.robots.named import named
from tests.robots.worlds import ball, ball_clearance, on_sphere, random_obstacles

SIZES = (0, 1, 2, 15, 16, 17, 40)  # of a batch: below, at and above what one query holds


@pytest.mark.parametrize("margin", [0.0, 0.03])
@pytest.mark.parametrize("count", [3, 90])
def test_a_batch_is_free_where_all_of_it_is_in_closed_form(count, margin):
    """A batch of balls is free exactly when the least closed-form clearance of its rows is at least the margin."""
    rng = np.random.default_rng(count)
    obstacles = random_obstacles(rng, count)
    validity, verdicts = Validity(ball(), obstacles, margin), []
    for i in range(600):
        beside = obstacles[i % count].position + rng.uniform(-0.2, 0.2, 3)
        Q = beside + rng.choice([0.01, 0.1]) * rng.normal(size=(SIZES[i % len(SIZES)], 3))
        clearance = ball_clearance(obstacles, Q).min(initial=np.inf)
        if abs(clearance - margin) > 1e-5:
            (found,) = validity.all_free(Q[None])
            assert found == (clearance > margin)
            verdicts.append(found)
    assert len(verdicts) > 500 and 0.1 < np.mean(verdicts) < 0.95


def test_batches_and_single_ones_do_not_disturb_each_other():
    """Asked in turn, by one checker, batches and single configurations keep their verdicts; so far outside of all."""
    rng = np.random.default_rng(5)
    obstacles = random_obstacles(rng, 80)
    validity = Validity(ball(), obstacles, 0.01)
    inside, outside = np.array(obstacles[0].position), np.full(3, 50.0)
    for ask in (validity.free, lambda q: validity.free_rows(q[None])[0], lambda q: validity.all_free(q[None, None])[0]):
        assert [bool(ask(q)) for q in (inside, outside, inside, inside, outside)] == [False, True, False, False, True]
    for _ in range(300):
        Q = rng.uniform(-1, 1, (rng.integers(1, 4), 3))
        one_by_one = [Validity.free(validity, q) for q in Q]
        assert validity.all_free(Q[None]).tolist() == [all(one_by_one)]
        assert validity.free_rows(Q).tolist() == one_by_one
        assert [validity.free(q) for q in Q] == one_by_one


class _Above:
    """A condition: the first joint is above a value."""

    def __init__(self, value: float) -> None:
        self.value = value

    def holds(self, q: np.ndarray) -> bool:
        return bool(q[0] > self.value)


@pytest.mark.parametrize("conditions", [(), (_Above(-1.0),)])
@pytest.mark.parametrize("crowd", [5, 80])
def test_an_arm_that_can_meet_itself(crowd, conditions):
    """An arm's batches have the verdict of its configurations: obstacles, itself, conditions and what it may touch."""
    rng, robot = np.random.default_rng(crowd), named("panda")
    far = [
        Obstacle(Shape.BOX, tuple(1.2 * direction), (0, 0, 0, 1), (0.05, 0.05, 0.05), name=f"block {i}")
        for i, direction in enumerate(on_sphere(rng, crowd))
    ]
    hand = next(name for name in robot.body_names if "hand" in name)
    validity = Validity(robot, far, 0.01, touching=[(hand, "block 0")], conditions=conditions)
    verdicts = []
    for size in SIZES * 20:
        start = rng.uniform(robot.lower, robot.upper)
        Q = start + np.linspace(0, 0.4, size)[:, None] * rng.normal(size=robot.dimension)
        verdicts += validity.all_free(Q[None]).tolist()
        one_by_one = [validity.free(q) for q in Q]
        assert verdicts[-1] == all(one_by_one)
        assert validity.free_rows(Q).tolist() == one_by_one
    assert 0.1 < np.mean(verdicts) < 0.9


def test_checks_count_configurations():
    """A batch counts as many checks as it has rows."""
    validity = Validity(ball(), random_obstacles(np.random.default_rng(0), 70))
    validity.all_free(np.zeros((2, 9, 3)))
    assert validity.checks == 18
    validity.free_rows(np.zeros((5, 3)))
    assert validity.checks == 23


@pytest.mark.parametrize("size", [1, 2, 7, 14, 16])
def test_sets_have_their_own_verdicts(size):
    """Sets asked together get the verdicts of their rows, free and colliding ones in turn, and none at all."""
    rng = np.random.default_rng(size)
    obstacles = random_obstacles(rng, 90)
    validity = Validity(ball(), obstacles, 0.01)
    Q = rng.uniform(-1, 1, (400, 1, 3)) + 0.02 * rng.normal(size=(400, size, 3))
    clearance = ball_clearance(obstacles, Q.reshape(-1, 3)).reshape(400, size)
    decided = (np.abs(clearance - 0.01) > 1e-5).all(axis=1)
    found = validity.all_free(Q)
    np.testing.assert_array_equal(found[decided], (clearance > 0.01).all(axis=1)[decided])
    assert 0.1 < found.mean() < 0.95 and decided.sum() > 390
    assert validity.all_free(Q[:0]).shape == (0,)
    np.testing.assert_array_equal(validity.free_rows(Q[decided, 0]), clearance[decided, 0] > 0.01)
    assert validity.free_rows(Q[:0, 0]).shape == (0,)
