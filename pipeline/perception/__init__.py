"""Perception: what a sampler sees of a scene. Points on the surfaces of its obstacles, gathered in a voxel grid."""

from pipeline.perception.surface import surface_area, surface_points
from pipeline.perception.voxels import Perception, VoxelParameters, clipped_share, read_voxels, scene_voxels, voxelise

__all__ = [
    "Perception",
    "VoxelParameters",
    "clipped_share",
    "read_voxels",
    "scene_voxels",
    "surface_area",
    "surface_points",
    "voxelise",
]
