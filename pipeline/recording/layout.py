"""A Foxglove layout that opens our recordings: scene and robot, progress, joints, and the summary as text."""

from pathlib import Path
from typing import Any

from pipeline.files import write_json
from pipeline.recording.content import WORLD
from pipeline.recording.messages import Topic


def foxglove_layout(joints: int = 7) -> dict[str, Any]:
    """Return the layout in the form that Foxglove and Lichtblick import from a file.

    Args:
        joints: how many joint positions to plot; an arm has 7, and a series that a recording lacks stays empty.
    """
    return {
        "configById": {
            "3D!scene": _view(),
            "Plot!progress": _plot(
                "Path [rad or m]", [f"{Topic.COUNTERS}.{name}" for name in ("path_length", "step_length")]
            ),
            "Plot!joints": _plot(
                "Joint positions [rad or m]", [f"{Topic.JOINT_STATES}.joints[{k}].position" for k in range(joints)]
            ),
            "RawMessages!summary": {
                "topicPath": Topic.LOG.value,
                "diffEnabled": False,
                "showFullMessageForDiff": False,
            },
        },
        "globalVariables": {},
        "userNodes": {},
        "playbackConfig": {"speed": 1},
        "layout": {
            "direction": "row",
            "splitPercentage": 65,
            "first": "3D!scene",
            "second": {
                "direction": "column",
                "splitPercentage": 67,
                "first": {"direction": "column", "first": "Plot!progress", "second": "Plot!joints"},
                "second": "RawMessages!summary",
            },
        },
    }


def write_layout(path: Path, joints: int = 7) -> None:
    """Write the layout as JSON without a schema name of ours: viewers refuse keys they do not know."""
    write_json(foxglove_layout(joints), path)


def _view() -> dict[str, Any]:
    return {
        "followMode": "follow-none",
        "followTf": WORLD,
        "cameraState": {
            "perspective": True,
            "distance": 4,  # [m]: an arm with its table, or the sphere of radius 1
            "phi": 60,
            "thetaOffset": 45,
            "target": [0, 0, 0],
            "targetOffset": [0, 0, 0],
            "targetOrientation": [0, 0, 0, 1],
            "fovy": 45,
            "near": 0.01,
            "far": 5000,
        },
        "scene": {"transforms": {"axisScale": 0.1, "showLabel": False}},
        "transforms": {},
        "topics": {
            Topic.TF.value: {"visible": True},
            Topic.SCENE.value: {"visible": True},
            Topic.PATH.value: {"visible": True, "type": "line", "lineWidth": 0.005},
            Topic.OBSTACLE_POINTS.value: {"visible": False},  # the same obstacles as in the scene
        },
        "layers": {
            "grid": {"layerId": "foxglove.Grid", "instanceId": "grid", "visible": True, "size": 4, "divisions": 8}
        },
    }


def _plot(title: str, paths: list[str]) -> dict[str, Any]:
    return {
        "title": title,
        "paths": [{"value": path, "enabled": True, "timestampMethod": "receiveTime"} for path in paths],
        "xAxisVal": "timestamp",
        "isSynced": True,
        "showLegend": True,
        "legendDisplay": "floating",
        "showXAxisLabels": True,
        "showYAxisLabels": True,
    }
