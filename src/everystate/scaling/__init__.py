"""What takes more than one process or machine: Ray, imported late, and collectors on it."""

from everystate.scaling.collectors import on_ray

__all__ = ["on_ray"]
