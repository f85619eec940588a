"""Constrained motion planning with learned samplers: the library behind the stages."""
