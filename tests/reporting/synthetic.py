"""Synthetic trials, paths and scenes that look like the sphere's."""

import numpy as np
import pandas as pd
from scipy.spatial.transform import Rotation

from pipeline.config import compose, load
from pipeline.reporting import Paper
from pipeline.reporting.frames import PATH_COLUMNS, TRIAL_COLUMNS
from pipeline.robots import Obstacle, Shape

PAPER = load(compose("paper/sphere").paper, Paper)
TIMES = {"CoMPNetX-FMT*": 0.6, "FMT*, tuned": 0.8, "FMT*": 1.2, "CoMPNetX-RRTConnect": 0.016, "RRTConnect": 0.012}
LENGTHS = {"CoMPNetX-FMT*": 1.0, "FMT*, tuned": 1.1, "FMT*": 1.02, "CoMPNetX-RRTConnect": 1.1, "RRTConnect": 1.4}
RATES = {"CoMPNetX-FMT*": 0.97, "FMT*, tuned": 0.92, "FMT*": 0.92, "CoMPNetX-RRTConnect": 1.0, "RRTConnect": 0.99}
SETTINGS = {  # as `method_settings` gives them
    "FMT*": {"planner": {"samples": 1000}, "sampler": {"batch": 64}},
    "FMT*, tuned": {"planner": {"samples": 500}, "sampler": {"batch": 64}, "tuned_from": "FMT*"},
    "CoMPNetX-FMT*": {
        "planner": {"samples": 300},
        "sampler": {"batch": 100, "n_ismp": 6},
        "compared_with": ["FMT*, tuned", "FMT*"],
    },
    "RRTConnect": {"planner": {}, "sampler": {}},
    "CoMPNetX-RRTConnect": {"planner": {}, "sampler": {}, "compared_with": ["RRTConnect"]},
}
for _parts in SETTINGS.values():
    _parts |= {"compared_with": _parts.get("compared_with", []), "tuned_from": _parts.get("tuned_from")}
ADHERENCES = ("projection", "atlas", "tangent_bundle")


def make_trials(
    problems: int = 40,
    scenarios: tuple[str, ...] = ("blocks", "bands"),
    methods: tuple[str, ...] = tuple(TIMES),
    adherences: tuple[str, ...] = ADHERENCES,
) -> pd.DataFrame:
    """Plausible trials: log-normal times, lengths above the geodesic, rates as in `RATES`."""
    rng = np.random.default_rng(7)
    rows = []
    for scenario in scenarios:
        geodesic = rng.uniform(0.5, 3.0, problems)
        for method in methods:
            for k, adherence in enumerate(adherences):
                for problem in range(problems):
                    solved = bool(rng.random() < RATES.get(method, 0.9))
                    learned = method.startswith("CoMPNetX")
                    time = TIMES.get(method, 0.1) * (1 + 0.1 * k) * rng.lognormal(0, 0.25) * (1 if solved else 4)
                    samples = int(rng.integers(500, 1500))
                    length = geodesic[problem] * LENGTHS.get(method, 1.0) * rng.uniform(1.0, 1.1)
                    row = dict.fromkeys(TRIAL_COLUMNS, 0)
                    row |= {
                        "environment": "sphere", "scenario": scenario, "scene": f"{40 + problem % 10}",
                        "problem": problem, "method": method, "planner": method.split("-")[-1],
                        "sampler": "compnetx" if learned else "uniform", "adherence": adherence, "seed": problem,
                        "status": "solved" if solved else "time limit", "claimed": solved, "solved": solved,
                        "rejection": "", "planning_time": time, "network_time": 0.3 * time if learned else 0.0,
                        "path_length": length if solved else np.nan, "samples": samples,
                        "fallback_samples": samples // 10 if learned else 0, "collision_checks": 40 * samples,
                        "projections": 30 * samples,
                    }  # fmt: skip
                    rows.append(row)
    return pd.DataFrame(rows, columns=list(TRIAL_COLUMNS))


def block_scene(count: int = 500) -> list[Obstacle]:
    """Cubes of side 0.1 m on the unit sphere, aligned to the tangent plane."""
    rng = np.random.default_rng(3)
    phi, theta = np.arccos(0.75 * rng.uniform(-1, 1, count)), np.pi * rng.uniform(-1, 1, count)
    made = []
    for p, t in zip(phi, theta, strict=True):
        centre = np.array([np.sin(p) * np.cos(t), np.sin(p) * np.sin(t), np.cos(p)])
        turn = Rotation.from_euler("ZY", [t, p]).as_quat()
        made.append(Obstacle(Shape.BOX, tuple(centre), tuple(turn), (0.1, 0.1, 0.1)))
    return made


def band_scene() -> list[Obstacle]:
    """Three slabs around the sphere, each in pieces that leave one gap."""
    made = []
    for low, high, gap in ((-0.8, -0.6, (1, 0)), (-0.1, 0.1, (0, -1)), (0.6, 0.8, (-1, 0))):
        z, height = (low + high) / 2, high - low
        g = np.array(gap, float)
        side = np.array([-g[1], g[0]])
        size = (*(np.abs(g) * 1.2 + np.abs(side) * 1.15), height)
        for sign in (-1, 1):
            centre = g * 0.6 + side * sign * (0.05 + 1.15 / 2)
            made.append(Obstacle(Shape.BOX, (*centre, z), (0, 0, 0, 1), size))
        centre = -g * 0.6
        size = (*(np.abs(g) * 1.2 + np.abs(side) * 2.4), height)
        made.append(Obstacle(Shape.BOX, (*centre, z), (0, 0, 0, 1), size))
    return made


def arc(start: np.ndarray, goal: np.ndarray, bend: float = 0.0, count: int = 40) -> np.ndarray:
    """A path (count, 3) on the unit sphere from start to goal, bent sideways."""
    s = np.linspace(0, 1, count)[:, None]
    side = np.cross(start, goal)
    raw = (1 - s) * start + s * goal + bend * np.sin(np.pi * s) * side
    return raw / np.linalg.norm(raw, axis=1, keepdims=True)


def make_paths(trials: pd.DataFrame) -> tuple[pd.DataFrame, dict[str, np.ndarray]]:
    """Paths of the solved trials from one start to one goal per problem, and samples of the first of each scenario."""
    rng = np.random.default_rng(5)
    ends: dict[tuple, np.ndarray] = {}
    rows, samples = [], {}
    bends = {"CoMPNetX-FMT*": 0.05, "FMT*": -0.1}
    for trial in trials[trials["solved"]].itertuples():
        key = (trial.scenario, trial.scene, trial.problem)
        if key not in ends:
            q = rng.normal(size=(2, 3))
            ends[key] = q / np.linalg.norm(q, axis=1, keepdims=True)
            if f"{trial.scenario}/start" not in samples:
                start, goal = ends[key]
                near = arc(start, goal)[rng.integers(0, 40, 200)] + rng.normal(0, 0.1, (200, 3))
                samples |= {
                    f"{trial.scenario}/start": start, f"{trial.scenario}/goal": goal,
                    f"{trial.scenario}/FMT*": unit(rng.normal(size=(200, 3))),
                    f"{trial.scenario}/CoMPNetX-FMT*": unit(near),
                }  # fmt: skip
        path = arc(*ends[key], bend=bends.get(trial.method, 0.5))
        rows.append((*key, 0, trial.method, trial.adherence, path.ravel().tolist(), len(path), 3))
    return pd.DataFrame(rows, columns=list(PATH_COLUMNS)), samples


def unit(points: np.ndarray) -> np.ndarray:
    """Points (N, 3) pulled onto the unit sphere."""
    return points / np.linalg.norm(points, axis=1, keepdims=True)
