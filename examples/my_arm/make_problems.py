"""Write problem files for the arm of this folder, which carries something level past boxes on a table.

From the root of the repository: python examples/my_arm/make_problems.py problems/my_arm
"""

import random
import sys
from pathlib import Path

import yaml

SPLITS = {"train": (4, 2), "validation": (2, 1), "test": (2, 1)}  # scenes, and problems in each: hundreds learn better
ROBOT = {
    "kind": "urdf",
    "parameters": {
        "name": "my_arm",
        "urdf": "examples/my_arm/my_arm.urdf",  # seen from the root; a path beside the problem file does as well
        "joints": [f"joint_{i}" for i in range(1, 8)],
        "tool": "hand",
        "rest": {"joint_2": 0.5, "joint_4": 1.4, "joint_6": 1.2},
    },
}
LEVEL = {"kind": "upright", "direction": [0, 0, -1]}  # the hand points at the table
TOP = 0.12  # [m] of the table
TABLE = {"name": "table", "shape": "box", "size": [0.6, 1.3, 0.04], "xyz": [0.55, 0.0, TOP - 0.02]}


def spot(rng: random.Random, left: float, right: float) -> tuple[float, float]:
    """Return x and y of a place on the table that the arm reaches [m], with y between left and right."""
    return round(rng.uniform(0.35, 0.55), 3), round(rng.uniform(left, right), 3)


def box(rng: random.Random, name: str) -> dict:
    """Return a box that stands on the table."""
    height = round(rng.uniform(0.15, 0.35), 3)
    return {
        "name": name,
        "shape": "box",
        "size": [0.08, 0.08, height],
        "xyz": [*spot(rng, -0.15, 0.15), round(TOP + height / 2, 4)],
    }


def above(rng: random.Random, left: float, right: float) -> dict:
    """Return where the hand starts or ends: over the table beside the boxes, turned about itself at will."""
    x, y = spot(rng, left, right)
    return {"region": {"x": x, "y": y, "z": round(rng.uniform(TOP + 0.1, TOP + 0.2), 3)}}


def main(folder: Path) -> None:
    """Write the files: those with equal obstacles are problems of one scene."""
    for split, (scenes, problems) in SPLITS.items():
        (folder / split).mkdir(parents=True, exist_ok=True)
        for scene in range(scenes):
            rng = random.Random(f"{split} {scene}")
            boxes = [box(rng, f"box {i}") for i in range(5)]
            for problem in range(problems):
                content = {"robot": ROBOT, "constraints": [LEVEL], "obstacles": [TABLE, *boxes]}
                content |= {"start": above(rng, -0.45, -0.25), "goal": above(rng, 0.25, 0.45)}
                path = folder / split / f"scene_{scene:03d}_{problem:03d}.yaml"
                path.write_text(yaml.safe_dump(content, sort_keys=False))


if __name__ == "__main__":
    main(Path(sys.argv[1]))
