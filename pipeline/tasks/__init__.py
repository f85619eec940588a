"""Tasks, built: robot, constraint, conditions and checkers of what a statement asks."""

from pipeline.tasks.build import Held, Setup, Task, build, forget, hold, robot_of, set_up

__all__ = ["Held", "Setup", "Task", "build", "forget", "hold", "robot_of", "set_up"]
