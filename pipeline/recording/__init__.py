"""Recordings of solved problems: MCAP files that Foxglove, Lichtblick and Rerun open."""

from pipeline.recording.content import Recording, time_parameterise
from pipeline.recording.layout import foxglove_layout, write_layout
from pipeline.recording.messages import Topic
from pipeline.recording.reader import StoredRecording, read_recording
from pipeline.recording.writer import write_recording

__all__ = [
    "Recording",
    "StoredRecording",
    "Topic",
    "foxglove_layout",
    "read_recording",
    "time_parameterise",
    "write_layout",
    "write_recording",
]
