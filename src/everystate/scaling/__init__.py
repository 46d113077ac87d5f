"""What takes more than one machine: collectors on a Ray cluster."""

from everystate.scaling.collectors import on_ray

__all__ = ["on_ray"]
