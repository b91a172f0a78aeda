"""Models of another descriptor than SPGF: learned, saved, restored, asked."""

from dataclasses import replace

import pytest
import torch
import trimesh
from trial_tables import trial_table

from spgf_torch.affordance.config import AffordanceConfig
from spgf_torch.affordance.model import GraspModel, load_model, save_model
from spgf_torch.affordance.sensed_collision import hand_volume
from spgf_torch.errors import InputError
from spgf_torch.experiment.costs import prediction_ms
from spgf_torch.experiment.describe import CachedSteps, Describer, Grasps
from spgf_torch.experiment.learning import learn_model
from spgf_torch.features.config import FeatureConfig
from spgf_torch.geometry import se3
from spgf_torch.hands.config import HandConfig
from spgf_torch.objects.grasp_object import GraspObject
from spgf_torch.progress import ProgressReporter
from spgf_torch.proposing.config import ProposingConfig
from spgf_torch.proposing.propose import Proposer
from spgf_torch.prototypes.config import PrototypeConfig
from spgf_torch.sensing.config import SensingConfig
from spgf_torch.settings import plain, settings
from spgf_torch.simulation.table import TrialTable

MESH = trimesh.creation.box((0.05, 0.06, 0.08))
BRICK = GraspObject("brick", "boxes", MESH, (MESH.vertices,), 0.2, MESH.center_mass, MESH.moment_inertia)
VOLUMES = {kind: hand_volume([trimesh.creation.box((0.01, 0.01, 0.01))]) for kind in ("NPG", "WPG")}
DESCRIBER = Describer(
    settings(SensingConfig, width=160, height=120, focal=144),
    settings(FeatureConfig, descriptor="patch_pairs"),
    settings(AffordanceConfig, features_per_object=30),
    VOLUMES,
    0,
)


@pytest.fixture(scope="module")
def tried() -> TrialTable:
    """Forty poses within 10 cm of the brick, half of each type, half of which succeeded."""
    generator = torch.Generator().manual_seed(1)
    T = se3.random_poses(40, generator, extent=0.1)
    return trial_table(T, torch.arange(2).repeat_interleave(20), (torch.rand(40, generator=generator) < 0.5).long())


@pytest.fixture(scope="module")
def model(tried: TrialTable, tmp_path_factory: pytest.TempPathFactory) -> GraspModel:
    """Of the brick, as it comes back from disk."""
    folder = tmp_path_factory.mktemp("model")
    described = DESCRIBER.describe([BRICK], [tried], ProgressReporter())[0]
    assert described.relations.shape[1] == 4
    learned = learn_model([described.with_success(tried.success)], described.relations[:3], DESCRIBER.affordance)
    made = {"sensing": DESCRIBER.sensing, "features": DESCRIBER.features, "affordance": DESCRIBER.affordance}
    said = {name: plain(values) for name, values in made.items()}
    said |= {"hand": plain(settings(HandConfig)), "prototypes": plain(settings(PrototypeConfig))}
    save_model(replace(learned, settings=said), folder)
    return load_model(folder)


def test_a_saved_model_knows_its_descriptor(model: GraspModel) -> None:
    """Proposals come from pairs of patches without a word: rings of 144 numbers would not fit centres of 4."""
    assert model.descriptor == "patch_pairs" and model.centres.shape == (3, 4)
    texlets = CachedSteps(DESCRIBER, BRICK, Grasps(torch.zeros(0, 4, 4), torch.zeros(0, dtype=torch.int64))).texlets
    proposing = settings(ProposingConfig, point_support=0, hypotheses=60, survivors=20, refined=5, rounds=1)
    proposals = Proposer.of(model, proposing, VOLUMES).propose(texlets)
    assert proposals.T_object_tcp.isfinite().all()


def test_its_prototypes_are_no_rings(model: GraspModel) -> None:
    with pytest.raises(InputError, match="expected spgf, whose prototypes are rings, got patch_pairs"):
        model.rings_deg()
    old = replace(model, settings={"features": {}})
    assert old.descriptor == "spgf"


def test_a_prediction_takes_time(model: GraspModel, tried: TrialTable) -> None:
    assert 0 < prediction_ms(model, DESCRIBER, [BRICK, BRICK], [tried, tried]) < 60_000


def test_a_model_card_says_the_descriptor() -> None:
    from spgf_torch.evaluation import card
    from spgf_torch.features.config import DESCRIPTORS

    assert set(card.DESCRIPTORS) == set(DESCRIPTORS)


def test_chance_follows_the_seed_the_object_and_the_step(tried: TrialTable) -> None:
    """An object's stream is its own, and each step's: the same again, another with any other of them."""
    named, seeded = replace(BRICK, name="block"), replace(DESCRIBER, seed=1)
    streams = [
        CachedSteps(settings_, obj, tried).generator(step)
        for settings_, obj, step in (
            *((DESCRIBER, BRICK, 0), (DESCRIBER, BRICK, 0)),
            *((seeded, BRICK, 0), (DESCRIBER, named, 0), (DESCRIBER, BRICK, 1)),
        )
    ]
    first, again, *others = (stream.initial_seed() for stream in streams)
    assert first == again and len({first, *others}) == 4
