"""Reporting: tables, figures, stills and Markdown pages from the files of the benchmark."""

from pipeline.reporting.environment_page import environment_page, environment_summary
from pipeline.reporting.figures import length_boxes, save, solved_over_time, success_bars, time_boxes, training_curves
from pipeline.reporting.globe import Globe
from pipeline.reporting.markdown import Illustration, Provenance, Section, index, page, write
from pipeline.reporting.paper import Paper, PaperResult
from pipeline.reporting.scene_pictures import path_pictures, robot_stills
from pipeline.reporting.sphere_pictures import Sampled, environment_figures, sphere_stills
from pipeline.reporting.stills import Stills
from pipeline.reporting.tables import paired_table, rejection_table, results_table
from pipeline.reporting.verdict import verdict_summary, verdict_table

__all__ = [
    "Globe",
    "Illustration",
    "Paper",
    "PaperResult",
    "Provenance",
    "Sampled",
    "Section",
    "Stills",
    "environment_figures",
    "environment_page",
    "environment_summary",
    "index",
    "length_boxes",
    "page",
    "paired_table",
    "path_pictures",
    "rejection_table",
    "results_table",
    "robot_stills",
    "save",
    "solved_over_time",
    "sphere_stills",
    "success_bars",
    "time_boxes",
    "training_curves",
    "verdict_summary",
    "verdict_table",
    "write",
]
