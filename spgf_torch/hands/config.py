"""Settings of a hand: its description in YAML (docs/howto/hand.md), and the names of its grasp types."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from spgf_torch.settings import bounded, choice, text


@dataclass
class JointConfig:
    """One joint, where it differs from what follows from the URDF and `closing`; N, N/m, N s/m of one that slides.

    `effort`: the most that its drive gives (Nm); `stiffness` (Nm/rad) and `damping` (Nm s/rad) of the drive.
    """

    effort: float | None = bounded(1e-6, 1e5, None)
    stiffness: float | None = bounded(0.0, 1e7, None)
    damping: float | None = bounded(0.0, 1e6, None)


@dataclass
class TCPConfig:
    """The tool centre point in the frame of the hand's base: where it is, m, and the closing direction there."""

    xyz: list[float] = field(default_factory=list)
    closing: list[float] = field(default_factory=list)


# Lists within mappings are `Any`, which OmegaConf cannot type; `preshapes` checks them.


@dataclass
class PreshapeConfig:
    """One grasp type: the open hand and how it closes. Joint values are deg, or m of joints that slide.

    Attributes:
        hold: joint -> value, of joints that stand still.
        open: joint -> value of the open hand, of joints that close; or
        opening: m between the pads of two opposing fingers, for which the joints are found.
        close: joint -> direction (sign) times share of the closing effort; nothing: measured.
        phases: several such mappings, closed one after the other, in the place of `close`.
        parallel: joint -> joint that it turns against (pads stay parallel), or {of, ratio, offset}.
        oppose: groups of fingers that press against each other; nothing: each finger is one.
        touch: opposing groups that must touch for a grasp to be held; nothing: all.
        pads: finger -> point of its closing face in the frame of its first link, m; nothing: measured by closing.
        tcp: nothing: midway between the pads.
        symmetry: so many turns about the approach make the same grasp.
        sampler: how candidates are drawn.
    """

    hold: dict[str, float] = field(default_factory=dict)
    open: dict[str, float] = field(default_factory=dict)
    opening: float | None = bounded(0.0, 1.0, None)
    close: dict[str, float] = field(default_factory=dict)
    phases: list[Any] = field(default_factory=list)
    parallel: dict[str, Any] = field(default_factory=dict)
    oppose: list[Any] = field(default_factory=list)
    touch: int | None = bounded(1, 20, None)
    pads: dict[str, Any] = field(default_factory=dict)
    tcp: TCPConfig | None = None
    symmetry: int | None = bounded(1, 12, None)
    sampler: str = choice("surface_pairs", "approach", default="surface_pairs")


@dataclass
class ClosingConfig:
    """How the fingers close; nothing: measured from the hand (docs/howto/hand.md).

    Attributes:
        effort: Nm, or N of joints that slide, of a joint whose share is 1.
        speed: rad/s or m/s of the target of a joint.
        time: s at most.
    """

    effort: float | None = bounded(1e-6, 1e5, None)
    speed: float | None = bounded(0.001, 100.0, None)
    time: float | None = bounded(0.01, 60.0, None)


@dataclass
class HandConfig:
    """A hand: a URDF as it comes, and the grasp types that it makes (frames: `spgf_torch.hands`).

    Attributes:
        urdf: a URDF or xacro file. packages: name -> folder, of `package://` paths; else as in `ROS_PACKAGE_PATH`.
        root: the hand is this link and what hangs from it; nothing: the URDF's root, past links that hold nothing.
        approach: out of the palm, in the frame of `root`.
        passive: links that are posed by their `<mimic>` joints, but not simulated (inner knuckles of a four-bar);
            nothing: those behind mimic joints that lead to no finger.
        joints: what differs from the URDF.
        fingers: name -> links that count as touching, with what is fixed to them; the first carries the pad.
        preshapes: name of a grasp type -> the open hand, and how it closes.
    """

    name: str = text()
    urdf: str = text()
    packages: dict[str, str] = field(default_factory=dict)
    root: str | None = text(None)
    approach: list[float] = field(default_factory=lambda: [0.0, 0.0, 1.0])
    passive: list[str] | None = None
    joints: dict[str, JointConfig] = field(default_factory=dict)
    fingers: dict[str, Any] = field(default_factory=dict)
    preshapes: dict[str, PreshapeConfig] = field(default_factory=dict)
    closing: ClosingConfig = field(default_factory=ClosingConfig)


def grasp_types(hand: HandConfig) -> tuple[str, ...]:
    """Names of the grasp types of a hand, sorted: every index into grasp types counts in this order."""
    return tuple(sorted(hand.preshapes))


# A hand has no defaults of its own: this one is what the paper grasps with.
HandConfig.DEFAULTS = "hand/sdh2.yaml"  # type: ignore[attr-defined]
