"""Settings of k-means."""

from __future__ import annotations

from dataclasses import dataclass, field

from spgf_torch.settings import bounded, defaults_from


@dataclass
@defaults_from("prototypes/minibatch.yaml")
class PrototypeConfig:
    """k-means of the relational parts (paper, section 3.2)."""

    num_clusters: int = bounded(1, 1000)
    restarts: int = bounded(1, 1000)
    subsample: int = bounded(100, 10_000_000)
    components: int = bounded(1, 10_000)
    parts: int = bounded(1, 1_000_000)
    finalists: int = bounded(1, 1000)
    breath: int = bounded(0, 100)
    batch_size: int = bounded(1, 1_000_000)
    epochs: int = bounded(1, 1000)
    refine_steps: int = bounded(1, 10_000)
    tolerance: float = bounded(0.0, 1.0)


@dataclass
class ConstellationConfig:
    """Words over constellations of prototypes (paper, section 6); older runs do not say: theirs have none."""

    words: int = field(default=0, metadata={"range": (0, 1000)})
    inner: float = field(default=0.03, metadata={"range": (0.0, 1.0)})
    outer: float = field(default=0.06, metadata={"range": (0.001, 1.0)})
    sectors: int = field(default=4, metadata={"range": (1, 36)})
    own: float = field(default=1.0, metadata={"range": (0.0, 100.0)})
