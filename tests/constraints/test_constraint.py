"""A constraint's value, Jacobian, Newton step, projection and frames are those of plain numpy."""

from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
import pytest
from scipy.linalg import subspace_angles

from pipeline.constraints import Compiled, Constraint, sphere_constraint
from pipeline.errors import ConstraintError, RobotError
from tests.robots.worlds import ball, chain, differences, held_tool, held_tool_value, pose_of, sphere, torus

KINDS = ["RX", "RY", "RZ", "revolute unaligned", "PX"]


@dataclass
class Case:
    """A constraint, its value in numpy, a configuration near the manifold, and how far from it to begin."""

    constraint: Constraint
    value: Any
    near: np.ndarray
    spread: float


def arm_case(rows: int) -> Case:
    rng = np.random.default_rng(11)
    robot = chain(rng, [*rng.choice(KINDS, 12).tolist(), "prismatic unaligned"])
    q0 = rng.uniform(-1, 1, 13)
    return Case(held_tool(robot, q0, rows), lambda q: held_tool_value(robot, q0, rows, q), q0, 0.2)


MAKERS = {
    "sphere": lambda: Case(sphere(), lambda q: np.array([np.linalg.norm(q) - 1]), np.array([0.6, 0.0, 0.8]), 0.5),
    "torus": lambda: Case(
        torus(),
        lambda q: np.array([np.hypot(np.hypot(q[0], q[1]) - 0.8, q[2]) - 0.4]),
        np.array([0.8, 0.0, 0.4]),
        0.2,
    ),
    "position": lambda: arm_case(3),
    "pose": lambda: arm_case(6),
}


@pytest.fixture(scope="module", params=MAKERS)
def case(request) -> Case:
    return MAKERS[request.param]()


def starts(case: Case, count: int, seed: int = 0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return case.near + case.spread * rng.normal(size=(count, case.constraint.n))


def algorithm_1(case: Case, q: np.ndarray, tolerance: float, iterations: int) -> tuple[np.ndarray, bool, int]:
    """Algorithm 1 word by word, with the Jacobian from differences; the steps taken are the last of the results."""
    for i in range(iterations):
        F = case.value(q)
        if np.linalg.norm(F) < tolerance:
            return q, True, i
        q = q - np.linalg.pinv(differences(case.value, q)) @ F
    return q, bool(np.linalg.norm(case.value(q)) < tolerance), iterations


def test_value_and_distance(case):
    """The value is that of pinocchio or of the closed form, the distance its norm."""
    for q in starts(case, 20):
        np.testing.assert_allclose(case.constraint.value(q), case.value(q), atol=1e-12)
        assert case.constraint.distance(q) == pytest.approx(np.linalg.norm(case.value(q)), abs=1e-12)


def test_jacobian(case):
    """The Jacobian is that of central differences of the independent value, of shape (k, n)."""
    for q in starts(case, 20):
        J = case.constraint.jacobian(q)
        assert J.shape == (case.constraint.k, case.constraint.n)
        np.testing.assert_allclose(J, differences(case.value, q), atol=1e-8)


def test_results_are_copies(case):
    """A value or Jacobian kept is not changed by the next call, although the buffers behind are shared."""
    first, second = starts(case, 2)
    value, J, projected = (
        case.constraint.value(first),
        case.constraint.jacobian(first),
        case.constraint.project(first).q,
    )
    kept = value.copy(), J.copy(), projected.copy()
    case.constraint.value(second), case.constraint.jacobian(second), case.constraint.project(second)
    for array, copy in zip((value, J, projected), kept, strict=True):
        np.testing.assert_array_equal(array, copy)


def test_newton_step(case):
    """The symbolic step is q - pinv(J) F, the pseudoinverse taken by numpy."""
    q, p = ca.SX.sym("q", case.constraint.n), case.constraint.structure.p
    newton = ca.Function("newton", [q, p], list(case.constraint.newton(q)))
    for configuration in starts(case, 20):
        F, following = (np.asarray(part)[:, 0] for part in newton(configuration, case.constraint.numbers))
        expected = configuration - np.linalg.pinv(differences(case.value, configuration)) @ case.value(configuration)
        np.testing.assert_allclose(F, case.value(configuration), atol=1e-12)
        np.testing.assert_allclose(following, expected, atol=1e-6)


def test_projection_is_algorithm_1(case):
    """Projection takes the steps of Algorithm 1, as many of them, and ends where it ends."""
    counts = set()
    for q in starts(case, 15):
        found = case.constraint.project(q)
        expected, converged, iterations = algorithm_1(case, q, 1e-3, 50)
        assert (found.converged, found.iterations) == (converged, iterations)
        np.testing.assert_allclose(found.q, expected, atol=1e-6)
        counts.add(iterations)
    assert max(counts) >= 1


@pytest.mark.parametrize("iterations", [1, 2, 4])
def test_unrolled_projection_is_algorithm_1(case, iterations):
    """The projection inside whole-edge functions takes at most so many steps and tells ||F||^2 at the end."""
    q, p = ca.SX.sym("q", case.constraint.n), case.constraint.structure.p
    unrolled = ca.Function("unrolled", [q, p], list(case.constraint.projected(q, iterations, ca.SX(1e-6))))
    for configuration in starts(case, 10):
        found, violation = unrolled(configuration, case.constraint.numbers)
        expected, _, _ = algorithm_1(case, configuration, 1e-3, iterations)
        np.testing.assert_allclose(np.asarray(found)[:, 0], expected, atol=1e-6)
        assert float(violation) == pytest.approx(np.sum(case.value(expected) ** 2), abs=1e-6)


def test_projection_ends_within_tolerance_and_stays(case):
    """What is projected is within the tolerance by the independent value; projecting it again changes no bit."""
    converged = 0
    for q in starts(case, 40, seed=1):
        before = q.copy()
        once = case.constraint.project(q)
        np.testing.assert_array_equal(q, before)
        if once.converged:
            twice = case.constraint.project(once.q)
            np.testing.assert_array_equal(twice.q, once.q)
            assert twice.converged and twice.iterations == 0
            assert np.linalg.norm(case.value(once.q)) < 1e-3
            assert case.constraint.satisfied(once.q)
            converged += 1
    assert converged >= 20


def test_projection_onto_the_sphere_is_radial():
    """On the sphere, where the Jacobian is the direction itself, projection is q / |q| after one step."""
    constraint = sphere(tolerance=1e-9)
    for q in np.random.default_rng(2).normal(size=(20, 3)):
        found = constraint.project(q)
        assert found.converged and found.iterations == 1
        np.testing.assert_allclose(found.q, q / np.linalg.norm(q), atol=1e-12)


def test_tolerance_is_the_bound():
    """A configuration is satisfied just below the tolerance and not just above; projection leaves the first alone."""
    for tolerance in (1e-2, 1e-3, 1e-6):
        constraint = sphere(tolerance=tolerance)
        below, above = np.array([1 + 0.999 * tolerance, 0, 0]), np.array([1 + 1.001 * tolerance, 0, 0])
        assert constraint.satisfied(below) and not constraint.satisfied(above)
        assert constraint.project(below).iterations == 0 and constraint.project(above).iterations == 1


@pytest.mark.parametrize("count", [0, 1, 63, 64, 65, 130])
def test_batch_is_single(case, count):
    """Values and projections of a batch are those of its rows one by one, to the last bit, across block boundaries."""
    Q = starts(case, count, seed=count)
    before = Q.copy()
    X, converged = case.constraint.project_batch(Q)
    singles = [case.constraint.project(q) for q in Q]
    np.testing.assert_array_equal(Q, before)
    assert X.shape == Q.shape and converged.shape == (count,)
    np.testing.assert_array_equal(X, np.array([single.q for single in singles]).reshape(X.shape))
    np.testing.assert_array_equal(converged, [single.converged for single in singles])
    values = case.constraint.value_batch(Q)
    np.testing.assert_array_equal(values, np.array([case.constraint.value(q) for q in Q]).reshape(values.shape))


@pytest.mark.parametrize("count", [63, 64, 65, 130])
def test_batch_is_single_where_rows_do_not_converge(count):
    """Rows that run out of iterations, have no Jacobian or hold a NaN spoil neither the others nor their order."""
    q = ca.SX.sym("q", 3)
    constraint = Constraint("valley", q, ca.norm_2(q) * (q[2] - q[0] ** 2), tolerance=1e-3, max_iterations=3)
    rng = np.random.default_rng(count)
    Q = rng.uniform(-1.5, 1.5, (count, 3))
    Q[5::9, 2] = Q[5::9, 0] ** 2
    Q[3::11] = 0.0  # where the norm has no derivative
    Q[::7] = np.nan
    X, converged = constraint.project_batch(Q)
    singles = [constraint.project(q) for q in Q]
    np.testing.assert_array_equal(X, [single.q for single in singles])
    np.testing.assert_array_equal(converged, [single.converged for single in singles])
    assert not converged[::7].any()
    finite = np.isfinite(X).all(axis=1)
    assert 0.1 < converged[finite].mean() < 0.9


def test_batches_do_not_remember():
    """A batch after one that ended in NaN gives what it gives at first."""
    constraint, Q = sphere(), np.random.default_rng(0).normal(size=(10, 3))
    expected, _ = constraint.project_batch(Q)
    constraint.project_batch(np.full((64, 3), np.nan))
    found, converged = constraint.project_batch(Q)
    assert converged.all()
    np.testing.assert_array_equal(found, expected)


def test_frame(case):
    """Tangent and normal bases are orthonormal and orthogonal; J Phi = 0 (eq. 1); the normals span J's rows."""
    n, k = case.constraint.n, case.constraint.k
    assert case.constraint.manifold_dimension == n - k
    for q in starts(case, 10):
        tangent, normal = case.constraint.frame(q)
        assert tangent.shape == (n, n - k) and normal.shape == (n, k)
        basis = np.hstack([tangent, normal])
        np.testing.assert_allclose(basis.T @ basis, np.eye(n), atol=1e-12)
        J = differences(case.value, q)
        np.testing.assert_allclose(J @ tangent, 0, atol=1e-8)
        assert subspace_angles(J.T, normal).max() < 1e-7


def two_rows(expression) -> Constraint:
    q = ca.SX.sym("q", 4)
    return Constraint("pair", q, expression(q))


def test_rank_deficient_points_are_named():
    """Where rows depend on one another the frame is refused by name, with its rank; nearby it is not."""
    constraint = two_rows(lambda q: ca.vertcat(q[0], q[0] * q[1] + q[2] ** 2))
    constraint.frame(np.array([0.1, 0.2, 0.3, 0.0]))
    with pytest.raises(ConstraintError, match=r"'pair' has rank 1 of 2 at q = \[0\. 5\. 0\. 0\.\]"):
        constraint.frame(np.array([0.0, 5.0, 0.0, 0.0]))
    dependent = two_rows(lambda q: ca.vertcat(q[0] + 0.1 * q[1], 3 * (q[0] + 0.1 * q[1]) + q[2] ** 2))
    with pytest.raises(ConstraintError, match=r"has rank 1 of 2"):  # but for rounding
        dependent.frame(np.array([0.3, 0.2, 0.0, 0.0]))
    constraint = two_rows(lambda q: ca.vertcat(q[0] ** 2, q[1] ** 2))
    with pytest.raises(ConstraintError, match=r"has rank 0 of 2"):
        constraint.frame(np.zeros(4))


def test_no_frame_without_a_jacobian():
    """At the centre of the sphere, where the Jacobian is undefined, and for a NaN the frame is refused by name."""
    for q in (np.zeros(3), np.array([np.nan, 0.0, 1.0])):
        with pytest.raises(ConstraintError, match="'sphere' has no finite Jacobian"):
            sphere().frame(q)


@pytest.mark.parametrize("rows", [0, 3, 4])
def test_rows_must_leave_a_manifold(rows):
    """A constraint with no rows, or as many as variables or more, is refused with both numbers."""
    q = ca.SX.sym("q", 3)
    with pytest.raises(ConstraintError, match=rf"'bad' has {rows} rows on 3 variables"):
        Constraint("bad", q, ca.vertcat(*[q[i % 3] * (i + 1) for i in range(rows)]))


def test_free_symbols_are_named():
    """An expression of symbols other than the configuration is refused, naming them."""
    q, stranger = ca.SX.sym("q", 3), ca.SX.sym("stranger")
    with pytest.raises(ConstraintError, match=r"symbols other than its configuration: \['stranger'\]"):
        Constraint("bad", q, q[0] - stranger)


@pytest.mark.parametrize("tolerance", [0.0, -1e-3, np.inf, np.nan])
def test_tolerance_must_be_positive(tolerance):
    """A tolerance of zero, below, infinite or undefined is refused with its value."""
    with pytest.raises(ConstraintError, match=rf"tolerance {tolerance}; it must be finite and above 0"):
        sphere(tolerance=tolerance)


def test_iterations_must_be_positive():
    """No iterations are refused."""
    with pytest.raises(ConstraintError, match="has 0 iterations"):
        sphere(max_iterations=0)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_nothing_undefined_is_on_the_manifold(case, bad):
    """A configuration with a NaN or an infinity in any place is never satisfied and never converges."""
    for joint in (0, case.constraint.n // 2, case.constraint.n - 1):
        q = case.near.copy()
        q[joint] = bad
        assert not case.constraint.satisfied(q)
        assert not case.constraint.project(q).converged
        assert not case.constraint.project_batch(q[None])[1][0]


def test_sphere_is_the_distance_to_a_sphere():
    """For a frame of any robot the value is |p(q)| - radius with pinocchio's p, and one row."""
    rng = np.random.default_rng(4)
    robot = chain(rng, ["RX", "RY", "PZ", "RZ"])
    constraint = sphere_constraint(robot, "tool", 0.7)
    assert (constraint.k, constraint.n) == (1, 4)
    for q in rng.uniform(-2, 2, (10, 4)):
        expected = np.linalg.norm(pose_of(robot, q).translation) - 0.7
        np.testing.assert_allclose(constraint.value(q), [expected], atol=1e-12)


@pytest.mark.parametrize("radius", [0.0, -1.0, np.nan])
def test_sphere_needs_a_radius(radius):
    """A radius that is not positive is refused with its value; an unknown frame by the robot."""
    with pytest.raises(ConstraintError, match=rf"radius is {radius} m"):
        sphere_constraint(ball(), "point", radius)
    with pytest.raises(RobotError, match="no frame 'tip'"):
        sphere_constraint(ball(), "tip")


@pytest.mark.parametrize("shape", [(1, 1), (3, 1), (1, 4), (2, 3)])
def test_compiled_arrays_are_transposed(shape):
    """A CasADi matrix (r, c) goes in and out as an array (c, r), a column as (r,); scalars and vectors mix."""
    A, s = ca.SX.sym("A", *shape), ca.SX.sym("s")
    function = Compiled(ca.Function("scaled", [A, s], [s * A, A.T]))
    array = np.arange(1.0, np.prod(shape) + 1).reshape(shape[::-1] if shape[1] > 1 else shape[0])
    scaled, turned = function(array, 2.0)
    np.testing.assert_array_equal(scaled, 2 * array)
    np.testing.assert_array_equal(turned.reshape(-1), array.T.reshape(-1))
    assert isinstance(function, Compiled)
    with pytest.raises(ValueError, match=r"shorter|longer"):
        function(array)


@pytest.mark.parametrize("columns", [1, 4])
def test_bound_arguments_stay(columns):
    """What the last arguments are bound to is not asked for at a call, serves all columns and is not changed by one."""
    x, s, t = ca.SX.sym("x", 2), ca.SX.sym("s"), ca.SX.sym("t", 2)
    scaled = ca.Function("scaled", [x, s, t], [s * x + t])
    function = Compiled(scaled.map(columns) if columns > 1 else scaled, bound=[3.0, np.array([10.0, 20.0])])
    assert len(function.arguments) == 1
    for _ in range(2):
        X = np.random.default_rng(0).normal(size=(columns, 2)).reshape(function.arguments[0].shape)
        np.testing.assert_allclose(function(X)[0], 3 * X + np.array([10.0, 20.0]), atol=1e-15)
