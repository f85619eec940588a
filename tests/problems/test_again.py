"""Problems asked one after the other share what they have in common, and come out as each would by itself."""

from pathlib import Path

import numpy as np

from pipeline.planning import solve
from pipeline.problems import read_problem
from pipeline.tasks import forget

EXAMPLES = Path(__file__).parents[2] / "examples"
BOX = {"name": "box", "shape": "box", "size": [0.2, 0.08, 0.45], "xyz": [0.55, 0.05, 0.425]}
TABLE = {"name": "table", "shape": "box", "size": [0.9, 1.4, 0.04], "xyz": [0.65, 0.0, 0.18]}
QUESTIONS = [  # changes of examples/upright_panda.yaml, and whether they keep robot and constraint
    ({}, True),
    ({"goal": {"region": {"y": 0.3}}}, True),
    ({"start": {"pose": {"xyz": [0.5, -0.3, 0.27]}}}, True),
    ({"obstacles": [TABLE, BOX]}, True),
    ({"grasps": []}, False),
    ({"constraints": []}, False),
    ({}, True),
]


def test_again_and_again():
    """Another start, goal or scene takes robot and constraint as they are; paths are those of problems asked alone."""
    alone = []
    for changes, _ in QUESTIONS:
        forget()
        alone.append(solve(read_problem(EXAMPLES / "upright_panda.yaml", time_limit=60.0, **changes)))
    forget()
    first = solve(read_problem(EXAMPLES / "upright_panda.yaml", time_limit=60.0))
    for (changes, same), expected in zip(QUESTIONS, alone, strict=True):
        found = solve(read_problem(EXAMPLES / "upright_panda.yaml", time_limit=60.0, **changes))
        assert found.solved and expected.solved
        np.testing.assert_array_equal(found.path, expected.path)
        assert (found.built.constraint is first.built.constraint) == same
        if same:
            assert found.built.robot is first.built.robot
        else:
            assert found.built.setup.held.arm is first.built.setup.held.arm  # the arm without what it holds
