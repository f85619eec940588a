"""Implicit constraints F(q) = 0."""

from pipeline.constraints.base import Constraint, Projection
from pipeline.constraints.compiled import Compiled, compiled
from pipeline.constraints.sphere import sphere_constraint

__all__ = ["Compiled", "Constraint", "Projection", "compiled", "sphere_constraint"]
