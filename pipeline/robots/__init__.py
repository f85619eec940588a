"""Robots: pinocchio models, symbolic kinematics, obstacles and collision checking."""

from pipeline.robots.bodies import Geometry
from pipeline.robots.clearance_bounds import ClearanceBounds, obstacle_numbers
from pipeline.robots.collision import Validity
from pipeline.robots.contact import Contact, Pair
from pipeline.robots.description import Movable
from pipeline.robots.grasp import attach
from pipeline.robots.model import Robot, point_robot
from pipeline.robots.numbers import Numbers
from pipeline.robots.obstacles import PRIMITIVES, Obstacle, Shape, obstacles_from_frame, obstacles_to_frame
from pipeline.robots.placement import IDENTITY, Placement
from pipeline.robots.standing import stands_clear
from pipeline.robots.urdf import UrdfRobot

ROBOTS = {"urdf": UrdfRobot}

__all__ = [
    "IDENTITY",
    "PRIMITIVES",
    "ROBOTS",
    "ClearanceBounds",
    "Contact",
    "Geometry",
    "Movable",
    "Numbers",
    "Obstacle",
    "Pair",
    "Placement",
    "Robot",
    "Shape",
    "UrdfRobot",
    "Validity",
    "attach",
    "obstacle_numbers",
    "obstacles_from_frame",
    "obstacles_to_frame",
    "point_robot",
    "stands_clear",
]
