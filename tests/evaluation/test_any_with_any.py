"""Any planner with any sampler and adherence in any environment plans or says why not, and claims nothing wrong."""

import numpy as np
import pandas as pd
import pytest

from pipeline.config import compose, load
from pipeline.environments import FamilyEnvironment
from pipeline.evaluation.trials import Experiment, Method, run_trials
from pipeline.learning.choices import Learned
from pipeline.learning.compnetx import CompnetxNetwork, Layers, untrained
from pipeline.learning.task_kinds import task_kinds
from pipeline.planners import PlanStatus
from pipeline.schema import Choice
from pipeline.spec.scene import Scene, Split
from pipeline.tasks import set_up
from pipeline.verification.verdict import VerifierParameters
from tests.evaluation.test_trials import ENVIRONMENT as SPHERE

# One robot each, of another kind: seven joints, a closed chain of two arms, joints that turn, a point on a torus.
FAMILIES = ("transport_panda", "tray_baxter", "transport_kinova", "maze")
SAMPLERS = {"uniform": Choice("uniform", {"batch": 8}), "compnetx": Choice("compnetx", {"batch": 4, "n_ismp": 5})}
PLANNERS = {"FMT*": Choice("fmt", {"samples": 40}), "RRT": Choice("rrt"), "RRTConnect": Choice("rrtconnect")}
METHODS = {
    f"{planner}, {sampler}": Method(f"{planner}, {sampler}", PLANNERS[planner], SAMPLERS[sampler])
    for planner in PLANNERS
    for sampler in SAMPLERS
}
LIMIT = 0.15  # [s] per plan: most are not to be solved in it by these small settings, and need not be


def of(family: str) -> tuple[FamilyEnvironment | object, dict[str, Choice]]:
    """Return an environment and the adherence methods it is planned with."""
    if family == "sphere":
        config = compose("benchmark").experiment.adherences
        return SPHERE, {name: load(choice, Choice) for name, choice in config.items()}
    setting = compose(f"family/{family}").family
    robot = None if setting.kind == "maze" else load(setting.robot, Choice)
    more = {**setting.parameters, "rows": 2, "columns": 4} if setting.kind == "maze" else {}
    environment = FamilyEnvironment(family, setting.kind, robot, 3, setting.margin, setting.self_margin, more)
    adherences = {name: load(choice, Choice) for name, choice in setting.adherences.items()}
    return environment, {
        name: Choice(a.kind, {k: v for k, v in a.parameters.items() if k != "native"}) for name, a in adherences.items()
    }


def learned_nothing(scene: Scene) -> Learned:
    """Return a network that has learned nothing, for the robot of a scene."""
    setup = set_up(scene.statement)
    kinds = task_kinds([(setup.robot, setup.constraint)], centre=False)
    model = untrained(Layers(scene_hidden=8, scene_code=8, hidden=(16, 8), dropout_layers=2), kinds, 11, 0)
    return Learned(CompnetxNetwork(model), {scene.name: np.zeros((11, 11, 11), bool)})


@pytest.fixture(scope="module", params=("sphere", *FAMILIES))
def trials(request) -> pd.DataFrame:
    environment, adherences = of(request.param)
    scene = environment.scenes({Split.TEST: 1})[0]
    experiment = Experiment(METHODS, adherences, LIMIT, 4, VerifierParameters())
    return run_trials(experiment, environment, {scene.name: scene}, learned_nothing(scene), environment.tasks(scene, 1))


def test_every_combination_has_its_row(trials):
    """Every planner with every sampler and adherence ends with one of the statuses that a plan may have."""
    assert len(trials) == len(METHODS) * 3 and not trials.duplicated(["method", "adherence"]).any()
    assert set(trials["status"]) <= {status.value for status in PlanStatus}
    assert (trials["planning_time"] < LIMIT + 1.0).all()  # [s] this machine may be busy
    asked = trials["sampler"] == "compnetx"
    assert (trials.loc[~asked, "network_calls"] == 0).all() and (trials.loc[asked, "network_calls"] <= 5).all()


def test_what_is_claimed_passes(trials):
    """The verifier refuses no path that a planner claims, and some are found."""
    assert trials["solved"].any()
    assert list(trials.loc[trials["claimed"] & ~trials["solved"], "rejection"]) == []


def test_scenes_that_ask_for_different_things_share_a_table():
    """Tasks of an arm with a tool and of two arms with a tray, in one table, are planned and judged as each alone."""
    experiment = Experiment(
        {"c": Method("c", Choice("rrtconnect", {"direct": True}), Choice("uniform", {"directions": True}))},
        {"projection": Choice("projection")}, 60.0, 4, VerifierParameters(),
    )  # fmt: skip
    environments = [of(family)[0] for family in ("transport_panda", "tray_baxter")]
    scenes = [environment.scenes({Split.TEST: 1})[0] for environment in environments]
    tables = [environment.tasks(scene, 1) for environment, scene in zip(environments, scenes, strict=True)]
    statements = tuple(scene.statement for scene in scenes)
    both = Scene("both", scenes[0].name, Split.TEST, statements)  # the second task is a second leg of one scene
    table = pd.concat([tables[0], tables[1].assign(scene=both.name, leg=1)])
    found = run_trials(experiment, environments[0], {both.name: both}, None, table)
    assert found["leg"].tolist() == [0, 1] and found["dimension"].tolist() == [7, 14]
    assert found["solved"].all() and set(found["scenario"]) == {"both"}
    alone = run_trials(experiment, environments[0], {scenes[0].name: scenes[0]}, None, tables[0])
    assert np.array_equal(alone["path"][0], found["path"][0]) and alone["seed"][0] == found["seed"][0]
