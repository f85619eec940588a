"""Machine code gives CasADi's results to the bit, is compiled once, and is done without where it cannot be had."""

from itertools import pairwise

import casadi as ca
import numpy as np
import pytest

from pipeline.constraints import Compiled, Expressions, structure_of, upright
from pipeline.constraints import native as native_module
from pipeline.constraints.native import native
from pipeline.constraints.structure import forget
from pipeline.manifolds import AdherenceParameters, ProjectionAdherence
from pipeline.robots import Validity
from tests.robots.named import configurations, named

needs_compiler = pytest.mark.skipif(native_module.shutil.which("cc") is None, reason="there is no C compiler")


@pytest.fixture(autouse=True)
def own_cache(tmp_path, monkeypatch):
    """Compiled functions of a test stay in its folder."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))


@needs_compiler
def test_walks_and_projections_are_the_same_to_the_bit():
    """With and without a compiler walks of Panda have the same states; batches and edges project alike."""
    robot, rng = named("panda"), np.random.default_rng(0)
    spaces = []
    for machine in (False, True):
        constraint = upright(robot, robot.tool)
        parameters = AdherenceParameters(resolution=0.05, native=machine)
        spaces.append(ProjectionAdherence(constraint, Validity(robot, ()), parameters))
    Q = configurations(robot, rng, 60)
    plain, machine_ = (space.constraint.project_batch(Q) for space in spaces)
    for one, other in zip(plain, machine_, strict=True):
        np.testing.assert_array_equal(one, other)
    on = plain[0][plain[1]]
    ends = on[:20], on[20:40]
    screened = [space.screen(*ends) for space in spaces]
    for one, other in zip(*screened, strict=True):
        np.testing.assert_array_equal(one, other)
    for q_from, q_to in pairwise(on):
        walks = [space.traverse(q_from, q_to) for space in spaces]
        assert walks[0].stop == walks[1].stop
        np.testing.assert_array_equal(walks[0].states, walks[1].states)


@needs_compiler
def test_compiled_once(tmp_path):
    """A second request finds the library of the first; another function makes another one; nothing else is left."""
    x = ca.SX.sym("x", 2)
    square, cube = (ca.Function("f", [x], [x**power]) for power in (2, 3))
    first = native(square)
    (library,) = tmp_path.rglob("*.so")
    made = library.stat().st_mtime_ns
    assert np.array_equal(first(np.array([2.0, 3.0])), square(np.array([2.0, 3.0])))
    native(square)
    assert library.stat().st_mtime_ns == made
    native(cube)
    assert len(list(tmp_path.rglob("*"))) == 3  # the folder and two libraries


def squares(name: str, machine: bool | None = True) -> Compiled:
    """A function of two numbers, asked for as machine code."""
    q = ca.SX.sym(name, 2)
    structure = structure_of(q, q**2, ca.SX(0, 1), "squares")
    return structure.compiled((name,), lambda: Expressions([q], [q**2]), np.empty(0), machine=machine)


def test_without_a_compiler(monkeypatch):
    """Without a compiler, or with one that fails, CasADi evaluates the function."""
    x = ca.SX.sym("x", 2)
    square = ca.Function("f", [x], [x**2])
    monkeypatch.setattr(native_module.shutil, "which", lambda name: None)
    assert native(square) is None
    assert squares("none")(np.array([2.0, 3.0]))[0].tolist() == [4.0, 9.0]
    monkeypatch.setattr(native_module.shutil, "which", lambda name: "/bin/false")
    assert native(square) is None


@needs_compiler
def test_a_broken_library_is_done_without(tmp_path):
    """A library that cannot be loaded is reported, and CasADi evaluates the function."""
    x = ca.SX.sym("broken", 2)
    native(ca.Function("broken", [x], [x**2]))
    (library,) = tmp_path.rglob("*.so")
    library.write_bytes(b"no library")
    assert squares("broken")(np.array([2.0, 3.0]))[0].tolist() == [4.0, 9.0]
    assert len(list(tmp_path.rglob("*.so"))) == 1


@needs_compiler
def test_what_was_compiled_before_is_taken(tmp_path):
    """Asked for only where it is kept, nothing is compiled; once it was, it is taken, also by another process' name."""
    x = np.array([2.0, 3.0])
    assert squares("kept", None)(x)[0].tolist() == [4.0, 9.0] and not list(tmp_path.rglob("*.so"))
    squares("kept", True)
    (library,) = tmp_path.rglob("*.so")
    forget()
    again = squares("kept", None)
    assert again(x)[0].tolist() == [4.0, 9.0]
    assert again.function.class_name() == "External"
    assert list(tmp_path.rglob("*.so")) == [library]
