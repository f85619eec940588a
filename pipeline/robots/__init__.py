"""Robots: pinocchio models, symbolic kinematics, obstacles and collision checking."""

from pipeline.robots.collision import Validity
from pipeline.robots.model import Robot, point_robot
from pipeline.robots.obstacles import Obstacle, Shape, obstacles_from_frame, obstacles_to_frame

__all__ = ["Obstacle", "Robot", "Shape", "Validity", "obstacles_from_frame", "obstacles_to_frame", "point_robot"]
