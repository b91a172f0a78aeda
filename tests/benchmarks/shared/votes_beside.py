"""The votes of local shapes beside a judge: as two more numbers of a hypothesis, and as a source of hypotheses."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import torch
from torch import Tensor

from shared.spgf_numbers import Described
from shared.tried_rows import Tried, trials_of
from spgf_torch.affordance.config import AffordanceConfig
from spgf_torch.affordance.pairs import cell_pairs
from spgf_torch.affordance.voting import vote_totals
from spgf_torch.experiment.described_object import DescribedObject
from spgf_torch.experiment.learning import learn_model
from spgf_torch.features.config import FeatureConfig
from spgf_torch.features.interface import VectorFeatures
from spgf_torch.proposing.hypotheses import Hypotheses
from spgf_torch.proposing.judge_features import in_images
from spgf_torch.proposing.propose import Proposer, Voters
from spgf_torch.proposing.sampling import same_grasp
from spgf_torch.settings import plain, settings


def examples(made: Tried, clouds: Sequence[Described], share: float = 1.0) -> list[DescribedObject]:
    """Each object as votes learn from it: seen alone from most sides, with the trials `trials_of` (made, share)."""
    config, found = settings(AffordanceConfig), []
    for bench, (poses, success) in zip(made.benches, trials_of(made, share), strict=True):
        best = max(range(len(bench.clouds)), key=lambda i: (bench.clouds[i].views, not bench.clouds[i].on_table))
        cloud = [c for c in clouds if c.obj == bench.index][best]
        frames, relations = cloud.frames[cloud.valid], cloud.relations[cloud.valid]
        generator = torch.Generator().manual_seed(bench.index)
        pairs = cell_pairs(frames, poses.T.float(), poses.grasp_type, config, generator)
        found.append(DescribedObject(relations, pairs, torch.zeros_like(success), made.trials.grasp_types, success))
    return found


def proposer_of(made: Tried, its: Sequence[DescribedObject], centres: Tensor) -> Proposer:
    """Votes learned from these objects, ready to propose."""
    affordance = settings(AffordanceConfig)
    about = {"affordance": plain(affordance), "features": plain(settings(FeatureConfig))}
    model = replace(learn_model(its, centres, affordance), settings=about)
    return Proposer.of(model, made.config.proposing, made.search.clearance.volumes)


def voters_of(proposer: Proposer, cloud: Described) -> Voters:
    return proposer.voters(VectorFeatures(cloud.frames, cloud.relations, cloud.valid))


def said(proposer: Proposer, cloud: Described, poses: Hypotheses) -> Tensor:
    """(H, 2) f32: the votes' mean log-odds gain, as it ranks proposals, and log(1 + votes)."""
    voters = voters_of(proposer, cloud)
    found = vote_totals(
        proposer.index, proposer.gains, voters.T_object_feature, voters.prototype, poses.T.float(), poses.grasp_type
    )
    mean = found.log_odds_gain / (found.votes + proposer.config.vote_shrinkage)
    return torch.stack([mean, torch.log1p(found.votes.float())], dim=1).float()


def votes(
    made: Tried, clouds: Sequence[Described], centres: Tensor, taught: Tensor, its: Sequence[DescribedObject]
) -> Tensor:
    """(R, 2) `said` of all rows, by votes of the objects of the mask (objects,) that are not of the row's own fold."""
    fold, found = torch.from_numpy(made.fold), torch.zeros(len(made.rows), 2)
    for group in range(made.config.folds):
        teachers = (taught & (fold != group)).nonzero()[:, 0].tolist()
        if not teachers:
            continue
        proposer = proposer_of(made, [its[i] for i in teachers], centres)
        for cloud in clouds:
            if fold[cloud.obj] == group:
                found[cloud.rows] = said(proposer, cloud, Hypotheses(made.T[cloud.rows], made.grasp_type[cloud.rows]))
    return found


def beyond_geometry(made: Tried, proposer: Proposer, cloud: Described, number: int) -> Hypotheses:
    """What the votes propose in the object's cloud of this number where geometry proposes no such grasp."""
    bench, config = made.benches[cloud.obj], made.config.proposing
    its = bench.clouds[number]
    features = VectorFeatures(cloud.frames, cloud.relations, cloud.valid)
    proposed = proposer.propose_from(features, its.seen.texlets.positions, its.around)
    poses = Hypotheses(proposed.T_object_tcp.float(), proposed.grasp_type)
    poses = poses.at(made.search.closes(poses.T, poses.grasp_type, its.seen.texlets.positions))
    poses = poses.at(in_images(its.seen, poses, made.search))
    known = bench.hypotheses[number].T
    alike = same_grasp(torch.cat([poses.T, known]), config.apart, config.apart_deg)[: len(poses), len(poses) :]
    return poses.at(~alike.any(1))
