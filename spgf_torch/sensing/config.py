"""Settings of the simulated cameras."""

from __future__ import annotations

from dataclasses import dataclass

from spgf_torch.settings import bounded, defaults_from


@dataclass
@defaults_from("sensing/four_cameras.yaml")
class SensingConfig:
    """Simulated RGB-D cameras on a circle around the object, their noise, and texlet extraction."""

    cameras: int = bounded(1, 64)
    distance: float = bounded(0.1, 5.0)
    elevation_deg: float = bounded(-89.0, 89.0)
    azimuth_deg: float = bounded(-360.0, 360.0)
    width: int = bounded(16, 4096)
    height: int = bounded(16, 4096)
    focal: float = bounded(1.0, 10000.0)
    axial_base: float = bounded(0.0, 0.1)
    axial_quadratic: float = bounded(0.0, 1.0)
    axial_nearest: float = bounded(0.0, 5.0)
    axial_grazing: float = bounded(0.0, 0.1)
    lateral_px: float = bounded(0.0, 10.0)
    disparity_step_px: float = bounded(0.0, 2.0)
    baseline: float = bounded(0.001, 1.0)
    flying_px: float = bounded(0.0, 1.0)
    edge_depth: float = bounded(0.0, 1.0)
    grazing_deg: float = bounded(1.0, 90.0)
    window: int = bounded(3, 15)
    depth_gate: float = bounded(0.0005, 0.1)
    min_window: int = bounded(3, 225)
    spacing: float = bounded(0.0005, 0.05)
    rival_deg: float = bounded(1.0, 180.0)
    min_members: int = bounded(1, 100)
