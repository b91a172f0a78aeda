"""A trained model that proposes grasps, in Python: what `predict` does, without Hydra.

    model = spgf_torch.load("outputs/train/latest")
    scene = spgf_torch.Scene.from_points(points, viewpoints=(0.0, 0.0, 0.0), table="find")  # (N, 3), m
    for grasp in model.predict(scene, top=10):
        print(grasp.type, grasp.probability, grasp.T_input_tcp)

Frames and units: the docstring of `spgf_torch.geometry`. Everything that comes out is in the frame of what went in.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from numbers import Integral
from pathlib import Path
from typing import Any

import numpy as np
import torch

from spgf_torch.affordance.model import GraspModel, check_device, load_model, model_settings
from spgf_torch.affordance.sensed_collision import hand_volumes
from spgf_torch.affordance.small_config import SmallConfig
from spgf_torch.errors import InputError
from spgf_torch.files.given_paths import check_free, model_and_judge
from spgf_torch.grasps.grasps import Grasps, Source
from spgf_torch.hands.carried_hand import load_carried
from spgf_torch.hands.config import HandConfig
from spgf_torch.hands.hand import Hand
from spgf_torch.hands.records import Grasp, Gripper, grippers_of, make_grasp
from spgf_torch.paths import path_of
from spgf_torch.proposing.bodies import bodies_of
from spgf_torch.proposing.borders import Borders
from spgf_torch.proposing.clearance import Plane, Surroundings
from spgf_torch.proposing.config import ProposingConfig, proposing_named
from spgf_torch.proposing.hidden_space import hidden_places
from spgf_torch.proposing.judge import Judge, load_judge
from spgf_torch.proposing.judge_features import Seen
from spgf_torch.proposing.judge_proposer import JudgedProposer
from spgf_torch.proposing.model_folder import Identity, body, write_model
from spgf_torch.proposing.proposals import Proposals
from spgf_torch.proposing.propose import Proposer
from spgf_torch.prototypes.naming import prototype_names
from spgf_torch.scene.arrays import cloud_of_arrays
from spgf_torch.scene.assembly import texlets_of
from spgf_torch.scene.cloud import vectors
from spgf_torch.scene.config import SceneConfig
from spgf_torch.scene.scene import Scene, check_spacing
from spgf_torch.sensing.config import SensingConfig
from spgf_torch.sensing.texlets import Texlets
from spgf_torch.sensing.unseen import DepthView
from spgf_torch.settings import settings, typed

__all__ = ["RETREAT", "Predictor", "block"]

# m that the hand waits back from a grasp before it approaches: a finger's length of the SDH-2.
RETREAT = 0.1


@dataclass(frozen=True, repr=False)
class Predictor:
    """What was learned for a hand, and the hand.

    Attributes:
        model: the votes' model; with it `proposer`; None: of a judge alone, whose grasps come without votes.
        sensing: how the training objects were sensed: spacing of texlets.
        grippers: grasp type -> the open hand.
        retreat: m between pregrasp and grasp.
        judged: who proposes in the place of the votes; None: the votes do.
        judge_folder: where that judge was loaded from.
        hand: the loaded hand, as its folder carries it, for whoever draws it closing.
        folder: where the votes were loaded from.
    """

    model: GraspModel | None
    sensing: SensingConfig
    grippers: Mapping[str, Gripper]
    proposer: Proposer | None
    retreat: float
    judged: JudgedProposer | None = None
    judge_folder: Path | None = None
    hand: Hand | None = None
    folder: Path | None = None

    def __repr__(self) -> str:
        known = self.model or (self.judged and self.judged.judge)
        which = f"{Identity.of(known).words()}; " if known else ""
        ranks = "votes" if self.judged is None else "a judge"
        return f"Predictor({which}grasp types {', '.join(sorted(self.grippers))}; ranked by {ranks})"

    @staticmethod
    def load(
        folder: str | Path | None,
        device: str = "cpu",
        proposing: ProposingConfig | str | None = None,
        retreat: float = RETREAT,
        judge: str | Path | None = None,
    ) -> Predictor:
        """What `train` or `judge` left in `folder`, and the hand that it was learned for.

        Args:
            folder: or a name (`spgf_torch.load`); None: an InputError that says how to choose.
            proposing: how it proposes, or the name of settings in conf/proposing, such as `clutter`.
            judge: the folder of a judge of this hand that proposes; None: the one in `folder`, if it holds one; `none`:
                the votes propose.

        Raises InputError where there is none, the hand's URDF is missing, or the judge is of another hand.
        """
        check_device(device)
        votes, ranks = model_and_judge(folder, judge)
        proposing = proposing or settings(ProposingConfig)
        config = proposing if isinstance(proposing, ProposingConfig) else proposing_named(proposing)
        sensing = sensing_of(votes, ranks)
        its_judge = None if ranks is None else load_judge(ranks)
        model = None if votes is None else load_model(votes, device)
        hand = (model or its_judge).settings["hand"]  # type: ignore[union-attr]
        folder_of_hand = votes or ranks
        assert folder_of_hand is not None  # one of them is there
        loaded = load_carried(typed(HandConfig, hand), folder_of_hand)
        grippers, volumes = grippers_of(loaded), hand_volumes(loaded)
        if model is None:
            alone = JudgedProposer.alone(its_judge, volumes, config)  # type: ignore[arg-type]
            return Predictor(None, sensing, grippers, None, retreat, alone, ranks, loaded)
        proposer = Proposer.of(model, config, volumes)
        beside = _with_votes(its_judge, proposer)
        return Predictor(model, sensing, grippers, proposer, retreat, beside, ranks, loaded, votes)

    @staticmethod
    def from_pretrained(name: str | Path, **how: Any) -> Predictor:
        """The model of a name, or in a folder: the same as `load`, called as the Hugging Face Hub calls it.

        The folder is a plain one, such as a downloaded copy of a model repository: nothing is fetched here.
        """
        return Predictor.load(name, **how)

    def save_pretrained(self, folder: str | Path, small: bool = True, replace: bool = False) -> Path:
        """Write all of it into a folder that works anywhere: votes, judge, hand, a card with the Hub's header.

        Args:
            small: votes with points left out and rounded (conf/small), a twentieth of the bytes.
            replace: a model that is there.

        Raises:
            InputError: something else is there, or a model and not `replace`.
        """
        assert self.hand is not None
        place = check_free(path_of("folder", folder), replace, "folder")
        judge = None if self.judged is None else self.judged.judge
        cards = "\n".join(body(each) for each in dict.fromkeys((self.folder, self.judge_folder)))
        write_model(place, self.model, judge, self.hand, settings(SmallConfig) if small else None, cards)
        return place

    @property
    def identity(self) -> dict[str, Any]:
        """Which model this is: its folder, and of votes and judge hand, objects, date and digest."""
        judge = None if self.judged is None else self.judged.judge
        folder = self.folder or self.judge_folder
        parts = {"votes": self.model, "judge": judge}
        said = {name: Identity.of(part).to_dict() for name, part in parts.items() if part is not None}
        return {"folder": None if folder is None else str(folder.resolve()), **said}

    def ready(self) -> Predictor:
        """Do now what the first prediction would do besides: tables of the model, and compiled loops; seconds."""
        if (proposer := self.proposer) is not None:
            _ = proposer.index, proposer.grasp_seeds, proposer.moves, self.names
        self.predict(block(self.sensing.spacing))
        return self

    @property
    def config(self) -> ProposingConfig:
        """How it proposes."""
        ranks = self.judged or self.proposer
        assert ranks is not None  # one of them ranks
        return ranks.config

    @cached_property
    def names(self) -> list[str]:
        """A word for each prototype: `rim 7`, or `fpfh 7` of a descriptor without rings; none of a judge alone."""
        if self.model is None:
            return []
        if (descriptor := self.model.descriptor) != "spgf":
            return [f"{descriptor} {k}" for k in range(len(self.model.centres))]
        return prototype_names(self.model.rings_deg())

    def texlets(
        self,
        points: np.ndarray,
        viewpoint: Sequence[float] | None = None,
        normals: np.ndarray | None = None,
        **changes: object,
    ) -> Texlets:
        """Texlets of a point cloud, such as for descriptors; `Scene.from_points` for grasps in a scene.

        Args:
            points: (N, 3) or (H, W, 3), m; NaN, infinity and 0 0 0: no reading. viewpoint: (3,) or (V, 3), where it was
                seen from; normals: in the shape of the points, out of the surface. Without both, the points must tell.
            changes: settings of conf/scene.

        Raises InputError for points that cannot be used, and for settings that texlets alone would forget: a table, and
        what lies outside of a crop box, are to be kept clear of.
        """
        for key in ("table", "crop_low", "crop_high"):
            if changes.get(key) is not None:
                raise InputError(
                    f"{key}: expected with spgf_torch.Scene.from_points(points, ...), which model.predict takes; "
                    "texlets alone would forget what a hand must keep clear of"
                )
        cloud = cloud_of_arrays(points, normals, viewpoint)
        return texlets_of(cloud, settings(SceneConfig, **changes), self.sensing, np.random.default_rng(0))

    def predict(
        self,
        scene: Scene | Texlets,
        top: int = 10,
        plane: np.ndarray | None = None,
        avoid: object = None,
        keep: Callable[[Grasp], bool] | None = None,
    ) -> Grasps:
        """The `top` best grasps of each type for each target, one list by score; none where nothing votes.

        No hand touches an obstacle or reaches below the table; none comes from below, if others can.

        Args:
            scene: made with this model's `sensing`; or texlets alone, to which nothing else belongs.
            plane: (4,) a, b, c, d of a table under texlets, a x + b y + c z + d the height above it, m.
            avoid: (A, 3) places in the scene's frame, m, where grasps failed before: none whose TCP is near one
                (`avoid_radius` of conf/proposing/clutter.yaml), if there are others.
            keep: says of a grasp whether it may be returned, such as whether a robot can reach it. It is asked before
                the cut to `top`, target by target, best grasp first, until there are `top` of each type: of all
                proposals, at most `count` of each type (conf/proposing), where it keeps few. What it raises is
                raised. One call takes what it takes: at 10 ms for inverse kinematics and one of five reachable, half
                a second for ten grasps of one type.

        Raises:
            InputError: what is given cannot be used, or `keep` says neither True nor False.
        """
        if not isinstance(top, Integral) or isinstance(top, bool) or top < 1:
            raise InputError(f"top: expected a whole number from 1, got {top!r:.40}")
        if keep is not None and not callable(keep):
            raise InputError(f"keep: expected a function of a grasp, got {keep!r:.40}")
        failed = None if avoid is None else self._places(avoid)
        if isinstance(scene, Texlets):
            if failed is not None:
                raise InputError("avoid: expected with a scene, got texlets")
            bare = scene_of_texlets(scene, plane, self.sensing.spacing)
            return self._found(self.grasps(self.propose(scene, plane), top, keep), bare)
        if not isinstance(scene, Scene):
            raise InputError(
                f"scene: expected a Scene or Texlets, got {type(scene).__name__}; make one with "
                "spgf_torch.Scene.from_points, from_depth or from_files"
            )
        check_spacing(scene, self.sensing)
        if plane is not None:
            raise InputError("plane: expected with texlets only; a scene has its table (table=[a,b,c,d])")
        found: list[Grasp] = []
        for target in scene.targets if scene.no_grasp is None else ():
            proposals = self._proposed((own := scene.of(target)).texlets, self.surroundings(own, failed), own.views)
            texlet = (scene.labels == target).nonzero()[:, 0].numpy()
            found += [_in_scene(grasp, texlet) for grasp in self.grasps(proposals, top, keep, target)]
        return self._found(sorted(found, key=lambda grasp: -grasp.score), scene)

    def _found(self, grasps: Sequence[Grasp], scene: Scene) -> Grasps:
        said = None
        if self.judged is not None:
            folder = None if self.judge_folder is None else str(self.judge_folder.resolve())
            known = {"unseen_space": scene.views is not None, "known": scene.unseen}
            said = {"folder": folder, **known, "sure": self.judged.judge.sure}
        source = Source(self, scene, np.eye(4))
        return Grasps(tuple(grasps), self.grippers, tuple(self.names), said, source, self.identity)

    def _places(self, avoid: object) -> torch.Tensor:
        """(A, 3) f32 places; InputError for anything else, and where the settings say of none how near is near."""
        if self.config.neighbours is None:
            raise InputError("avoid: expected a model loaded with proposing=clutter, got one without avoid_radius")
        try:
            places = np.asarray(avoid, dtype=np.float32).reshape(-1, 3)
        except (TypeError, ValueError):
            raise InputError(f"avoid: expected places (A, 3) in m, got {avoid!r:.40}") from None
        if not np.isfinite(places).all():
            raise InputError("avoid: expected finite places in m, got NaN or infinity")
        return torch.from_numpy(places)

    def surroundings(self, scene: Scene, failed: torch.Tensor | None = None) -> Surroundings:
        """What a hand must keep clear of in a scene, and the places (A, 3) where grasps failed before."""
        return surroundings_of(scene, self.config, self.retreat, failed)

    def propose(self, texlets: Texlets, plane: np.ndarray | None = None) -> Proposals:
        """All proposals, as tensors on the model's device."""
        return self._proposed(texlets, Surroundings(table=_table(plane), retreat=self.retreat), None)

    def _proposed(self, texlets: Texlets, around: Surroundings, views: tuple[DepthView, ...] | None) -> Proposals:
        """By the judge, where there is one, else by the votes."""
        if self.judged is not None:
            neighbours = self.config.neighbours
            bodies = None if neighbours is None else bodies_of(texlets, neighbours)
            return self.judged.propose(Seen(texlets, views or (), bodies), around)
        assert self.proposer is not None  # one of them ranks
        return self.proposer.propose(texlets, around)

    def grasps(
        self, proposals: Proposals, top: int, keep: Callable[[Grasp], bool] | None = None, target: int = 1
    ) -> list[Grasp]:
        """The `top` best proposals of each type, of those that `keep` keeps, with everything that a robot needs."""
        found: dict[int, Grasp] = {}
        wanted = dict.fromkeys(proposals.grasp_types, top)
        for i, code in enumerate(proposals.grasp_type.tolist()):
            if not wanted[grasp_type := proposals.grasp_types[code]]:
                continue
            grasp = self._grasp(proposals, i, target)
            if keep is None or _kept(keep, grasp):
                found[i] = grasp
                wanted[grasp_type] -= 1
        voted = [None] * len(found) if self.proposer is None else self.proposer.who_voted(proposals, list(found))
        return [replace(grasp, voters=voters) for grasp, voters in zip(found.values(), voted, strict=True)]

    def _grasp(self, proposals: Proposals, i: int, target: int) -> Grasp:
        """The grasp of one proposal."""
        grasp = make_grasp(
            self.grippers[proposals.grasp_types[int(proposals.grasp_type[i])]],
            proposals.T_object_tcp[i].cpu().numpy(),
            float(proposals.probability[i]),
            int(proposals.support[i]),
            proposals.voted_by[i],
            self.retreat,
        )
        judged = None
        if proposals.judged is not None:
            free, holds = proposals.judged[i].tolist()
            judged = (free, holds)
        numbers = proposals.numbers[i] if proposals.numbers else None
        return replace(grasp, score=float(proposals.score[i]), judged=judged, numbers=numbers, target=target)


def _kept(keep: Callable[[Grasp], bool], grasp: Grasp) -> bool:
    """What `keep` says of a grasp. Raises InputError where it is neither True nor False."""
    if not isinstance(said := keep(grasp), bool | np.bool_):
        raise InputError(f"keep: expected True or False of each grasp, got {said!r:.40}")
    return bool(said)


def scene_of_texlets(texlets: Texlets, plane: np.ndarray | None, spacing: float) -> Scene:
    """A scene of which texlets, maybe over a table (4,), are all that is known."""
    one = torch.ones(len(texlets), dtype=torch.int64)
    table = None if plane is None else vectors("plane", plane, (4,))
    return Scene(texlets, one, torch.zeros(0, 3), table, None, None, spacing, ())


def _in_scene(grasp: Grasp, texlet: np.ndarray) -> Grasp:
    """A grasp of one target in its scene: texlet i of the target is texlet[i] of the scene."""
    if grasp.voters is None:
        return grasp
    return replace(grasp, voters=replace(grasp.voters, texlet=texlet[grasp.voters.texlet]))


def surroundings_of(
    scene: Scene, config: ProposingConfig, retreat: float, failed: torch.Tensor | None = None
) -> Surroundings:
    """The same as `Predictor.surroundings`, for whoever else proposes with these settings."""
    up = None
    if scene.table is None and scene.gravity is not None:
        up = (torch.from_numpy(scene.gravity.up).float(), scene.gravity.steepest)
    borders = Borders.of(scene.texlets.positions, scene.borders)
    around = Surroundings(scene.obstacles, _table(scene.table), up, retreat, borders)
    if (neighbours := config.neighbours) is None:
        return around
    sensed = torch.cat([scene.texlets.positions, scene.obstacles])
    around = replace(around, hidden=hidden_places(sensed, scene.views or (), around.table, neighbours))
    return around if failed is None else replace(around, failed=failed, failed_radius=neighbours.avoid_radius)


def sensing_of(model: Path | None, judge: Path | None) -> SensingConfig:
    """How what is in a model's folder, or else in a judge's, was sensed."""
    if model is not None:
        return typed(SensingConfig, model_settings(model)["sensing"])
    assert judge is not None
    known = load_judge(judge).settings.get("sensing")
    return settings(SensingConfig) if known is None else typed(SensingConfig, known)


def _with_votes(judge: Judge | None, proposer: Proposer) -> JudgedProposer | None:
    """InputError where the judge is of another hand than the model."""
    try:
        return None if judge is None else JudgedProposer.of(judge, proposer)
    except InputError as error:
        raise InputError(f"{error}; or model=none, for the judge alone") from None


def _table(plane: np.ndarray | None) -> Plane | None:
    """A plane a x + b y + c z + d = 0, (a, b, c) to the free side, as what no hand reaches below."""
    return None if plane is None else Plane.of(tuple(np.asarray(plane[:3]).tolist()), -float(plane[3]))


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
