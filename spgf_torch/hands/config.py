"""Settings of a hand, and the names of its grasp types."""

from __future__ import annotations

from dataclasses import dataclass, field

from spgf_torch.settings import bounded, text

GRASP_TYPES = ("NPG", "WPG")


@dataclass
class FingerConfig:
    """One finger of the hand: its pad (a point of `pad_link`'s closing face, in that link's frame, m) and its joints.

    `proximal` closes the finger; `distal`, where there is one, turns against it so that the pads stay parallel.
    """

    pad_link: str = text()
    pad: list[float] = field(default_factory=list)
    proximal: str = text()
    distal: str = text("")


@dataclass
class HandConfig:
    """A gripper: a URDF and the roles of its joints (frames: palm z out of the palm; TCP +z approach, +x closing)."""

    name: str = text()
    urdf: str = text()
    base_link: str = text()
    fingers: list[FingerConfig] = field(default_factory=list)
    fixed_deg: dict[str, float] = field(default_factory=dict)
    openings: dict[str, float] = field(default_factory=dict)
    proximal_stiffness: float = bounded(0.0, 1e5)
    proximal_damping: float = bounded(0.0, 1e4)
    proximal_limit: float = bounded(0.0, 1e4)
    closing_torque: float = bounded(0.0, 1e4)
    closing_speed: float = bounded(0.001, 100.0)
    distal_stiffness: float = bounded(0.0, 1e5)
    distal_damping: float = bounded(0.0, 1e4)
    distal_limit: float = bounded(0.0, 1e4)


def grasp_types(hand: HandConfig) -> tuple[str, ...]:
    """Names of the grasp types of a hand, sorted: every index into grasp types counts in this order."""
    return tuple(sorted(hand.openings))


# A hand has no defaults of its own: this one is what the paper grasps with.
HandConfig.DEFAULTS = "hand/sdh2.yaml"  # type: ignore[attr-defined]
