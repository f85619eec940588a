import json
import re

from pipeline.recording import foxglove_layout, read_recording, write_layout, write_recording


def _strings(node):
    if isinstance(node, dict):
        for key, value in node.items():
            yield from (key, *_strings(value))
    elif isinstance(node, list):
        for value in node:
            yield from _strings(value)
    elif isinstance(node, str):
        yield node


def test_the_layout_names_only_topics_that_are_written(recording, tmp_path):
    """Every word that begins like a topic is one of a written file, and the scene shows frames, scene and path."""
    write_recording(tmp_path / "a.mcap", recording)
    written = read_recording(tmp_path / "a.mcap").topics
    layout = foxglove_layout()
    assert {re.split(r"[.\[]", word)[0] for word in _strings(layout) if word.startswith("/")} <= set(written)
    shown = {topic for topic, look in layout["configById"]["3D!scene"]["topics"].items() if look["visible"]}
    assert shown == {"/tf", "/scene", "/path"}


def test_every_panel_stands_in_the_tree_once():
    """The tree's leaves are the configured panels: a viewer drops what is configured but not placed."""

    def leaves(node):
        return [node] if isinstance(node, str) else [*leaves(node["first"]), *leaves(node["second"])]

    layout = foxglove_layout()
    assert sorted(leaves(layout["layout"])) == sorted(layout["configById"])


def test_plotted_fields_exist(recording, tmp_path):
    """Each plotted path follows fields of the topic's message, and there is one series per joint."""
    from foxglove_schemas_protobuf.JointStates_pb2 import JointStates

    from pipeline.recording.messages import PathProgress

    kinds = {"counters": PathProgress, "joint_states": JointStates}
    layout = foxglove_layout(joints=6)
    plotted = [p["value"] for name in ("Plot!progress", "Plot!joints") for p in layout["configById"][name]["paths"]]
    assert len([path for path in plotted if path.startswith("/joint_states")]) == 6
    for path in plotted:
        topic, *fields = re.sub(r"\[\d+\]", "", path).strip("/").split(".")
        descriptor = kinds[topic].DESCRIPTOR
        for field in fields:
            descriptor = descriptor.fields_by_name[field].message_type or descriptor.fields_by_name[field]


def test_the_layout_is_written_as_plain_json(tmp_path):
    """The file holds the layout and nothing else."""
    write_layout(tmp_path / "layout.json")
    assert json.loads((tmp_path / "layout.json").read_text()) == foxglove_layout()
