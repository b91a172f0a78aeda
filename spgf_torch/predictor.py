"""A trained model that proposes grasps, in Python: what `predict` does, without Hydra.

    model = spgf_torch.load("outputs/train/latest")
    texlets = model.texlets(points, viewpoint=(0.0, 0.0, 0.0))  # (N, 3), m; where the camera was, in the same frame
    for grasp in model.predict(texlets, top=10):
        print(grasp.type, grasp.probability, grasp.T_input_tcp)

Frames and units: the docstring of `spgf_torch.geometry`. Everything that comes out is in the frame of what went in.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
import torch

from spgf_torch.affordance.model import GraspModel, check_device, load_model
from spgf_torch.affordance.sensed_collision import hand_volume
from spgf_torch.config import HandConfig, InputError, ProposingConfig, SceneConfig, SensingConfig, find, settings, typed
from spgf_torch.exporting.records import Grasp, Gripper, grippers_of, make_grasp
from spgf_torch.proposing.clearance import Plane
from spgf_torch.proposing.propose import Proposals, Proposer
from spgf_torch.reporting.learned import descriptor_of, rings_deg
from spgf_torch.reporting.names import prototype_names
from spgf_torch.scene.cloud import Cloud
from spgf_torch.scene.scene import texlets_of
from spgf_torch.sensing.texlets import Texlets
from spgf_torch.trials.hand import load_hand

# m that the hand waits back from a grasp before it approaches: a finger's length of the SDH-2.
RETREAT = 0.1


@dataclass(frozen=True)
class Predictor:
    """A model with its hand.

    Attributes:
        sensing: how the model's training objects were sensed: spacing of texlets.
        grippers: grasp type -> the open hand.
        retreat: m between pregrasp and grasp.
    """

    model: GraspModel
    sensing: SensingConfig
    grippers: Mapping[str, Gripper]
    proposer: Proposer
    retreat: float

    @staticmethod
    def load(
        folder: str | Path, device: str = "cpu", proposing: ProposingConfig | None = None, retreat: float = RETREAT
    ) -> Predictor:
        """The model that `train` left in `folder`, and the hand that it was trained with.

        Raises InputError where there is none, or the hand's URDF is not here.
        """
        check_device(device)
        model = load_model(find(folder), device)
        grippers = grippers_of(load_hand(typed(HandConfig, model.settings["hand"])))
        volumes = {kind: hand_volume(gripper.shapes) for kind, gripper in grippers.items()}
        proposer = Proposer.of(model, proposing or settings(ProposingConfig), volumes)
        return Predictor(model, typed(SensingConfig, model.settings["sensing"]), grippers, proposer, retreat)

    def ready(self) -> Predictor:
        """Do now what the first prediction would do besides: tables of the model, and compiled loops; seconds."""
        proposer = self.proposer
        _ = proposer.index, proposer.shortlist, proposer.moves
        self.predict(block(self.sensing.spacing))
        return self

    @cached_property
    def names(self) -> list[str]:
        """A word for each prototype: `rim 7`, or `fpfh 7` of a descriptor without rings."""
        if (descriptor := descriptor_of(self.model)) != "spgf":
            return [f"{descriptor} {k}" for k in range(len(self.model.centres))]
        return prototype_names(rings_deg(self.model))

    def texlets(
        self,
        points: np.ndarray,
        viewpoint: Sequence[float] | None = None,
        normals: np.ndarray | None = None,
        **changes: object,
    ) -> Texlets:
        """Texlets of a point cloud.

        Args:
            points: (N, 3), m. viewpoint: (3,) or (V, 3), where it was seen from; normals: (N, 3), out of the surface.
                One of both must be given.
            changes: settings of conf/scene, such as `table="find"`.

        Raises InputError for points that cannot be used.
        """
        places = None if viewpoint is None else np.atleast_2d(_numbers("viewpoint", viewpoint))
        turned = None if normals is None else _numbers("normals", normals)
        cloud = Cloud(_numbers("points", points), turned, places)
        return texlets_of(cloud, settings(SceneConfig, **changes), self.sensing, np.random.default_rng(0))

    def predict(self, texlets: Texlets, top: int = 10, plane: np.ndarray | None = None) -> list[Grasp]:
        """The `top` best grasps of each type, one list by score: up to twice as many; none where nothing votes.

        Args:
            plane: (4,) a, b, c, d of a table, a x + b y + c z + d the height above it, m: no hand reaches below it.
        """
        return self.grasps(self.propose(texlets, plane), top)

    def propose(self, texlets: Texlets, plane: np.ndarray | None = None) -> Proposals:
        """All proposals, as tensors on the model's device."""
        table = None if plane is None else Plane.of(tuple(np.asarray(plane[:3]).tolist()), -float(plane[3]))
        return self.proposer.propose(texlets, table)

    def grasps(self, proposals: Proposals, top: int) -> list[Grasp]:
        """The best of the proposals, with everything that a robot needs."""
        kept = sorted({i for indices in proposals.best(top).values() for i in indices.tolist()})
        kinds = list(self.grippers)
        return [
            make_grasp(
                self.grippers[kinds[int(proposals.grasp_type[i])]],
                proposals.T_object_tcp[i].cpu().numpy(),
                float(proposals.probability[i]),
                int(proposals.support[i]),
                proposals.voted_by[i],
                self.retreat,
            )
            for i in kept
        ]


def _numbers(name: str, values: object) -> np.ndarray:
    try:
        return np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError, RuntimeError) as error:  # the last: a tensor that requires grad, or is elsewhere
        told = str(error).splitlines()[0][:100]
        raise InputError(f"{name}: expected an array of numbers, got {type(values).__name__}: {told}") from None


def block(spacing: float, side: float = 0.04) -> Texlets:
    """Texlets `spacing` (m) apart on a block that any hand can grasp, about the origin: something to try things on."""
    along = np.arange(-side / 2, side / 2, spacing) + spacing / 2
    u, v = (grid.ravel() for grid in np.meshgrid(along, along))
    positions, normals = [], []
    for axis in range(3):
        for sign in (-1.0, 1.0):
            face, normal = np.empty((len(u), 3)), np.zeros((len(u), 3))
            face[:, axis], face[:, axis - 1], face[:, axis - 2] = sign * side / 2, u, v
            normal[:, axis] = sign
            positions.append(face)
            normals.append(normal)
    return Texlets(*(torch.from_numpy(np.concatenate(parts)).float() for parts in (positions, normals)))
