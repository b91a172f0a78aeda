"""The model card: what a saved model was learned from, how well it did on novel objects, what it is for."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from spgf_torch.affordance.config import NESTED
from spgf_torch.evaluation import paper
from spgf_torch.evaluation.reliability import score_table
from spgf_torch.evaluation.results import KNOWS_MORE, NO_RATES, chosen_words
from spgf_torch.evaluation.success import ALL
from spgf_torch.experiment.config import TrainConfig, is_recorded
from spgf_torch.files.card_header import card_header
from spgf_torch.objects.config import CLASSES

USE = """\
Rank candidate grasps of this hand on household-sized rigid objects that were sensed from several sides:
`python -m spgf_torch.evaluate objects=FOLDER model=THIS_FOLDER`. A novel object's local shapes vote through the
prototypes learned here; each vote carries a probability and the number of trials near it."""

DESCRIPTORS = {
    "spgf": "Sliced Pineapple Grid Features",
    "fpfh": "Fast Point Feature Histograms",
    "patch_pairs": "pairs of surface patches",
}

LIMITS = """\
- Success means held in simulation (SAPIEN): rigid bodies, one friction value, no table, no arm, no contact sensing.
- Learned with this hand, this opening and closing and these cameras; another hand needs trials of its own.
- Probabilities are calibrated over candidates like those it was tried on. Among other candidates, or where successes
  are rarer or commoner, they are off.
- Objects unlike the training objects (thin cloth-like walls, handles thinner than the texlet spacing, transparent
  surfaces that a depth camera does not see) are outside of what was measured.
- Not a safety device: check reachability and collisions of the whole robot before moving."""


def model_card(results: Mapping[str, Any], config: TrainConfig, objects: int, trials: int, size: int) -> str:
    """The text of the model folder's README.md.

    Args:
        results: content of `results.json`.
        objects, trials: how many it was learned from. size: bytes of `model.safetensors`.
    """
    affordance, sensing, described = config.affordance, config.sensing, DESCRIPTORS[config.features.descriptor]
    header = card_header(config.hand.name, library_name="spgf_torch", pipeline_tag="robotics")
    return f"""{header}
# Grasp model, {config.hand.name}, K = {config.K}

Written by `python -m spgf_torch.train` from the run beside it; every setting is in `config.yaml`.

## Data
{objects} object{"s" * (objects > 1)}, {trials:,} {"recorded" if is_recorded(config.trials) else "simulated"} trials \
(`{config.trials}`), dataset `{results["dataset"][:16]}`.
{_seen(config)} by {sensing.cameras} simulated depth camera(s) at {sensing.distance:g} m with noise; seed {config.seed}.

## Settings
{_dictionary(results)}{config.K} prototypes of {described} of {1000 * config.features.radius:g} mm radius;
shape-grasp particles within {1000 * affordance.reach:g} mm, neighbourhoods of {1000 * affordance.kernel:g} mm and
{affordance.kernel_deg:g} deg, points with a support of at least {affordance.min_support:g}. The model file has
{size / 1e6:.0f} MB.

## Results on novel objects
{_measured(results, config) if NO_RATES not in results else _unmeasured(results, objects)}

## Intended use
{USE}

## Limits
{LIMITS}
"""


def _seen(config: TrainConfig) -> str:
    which = f"`{config.objects}`"
    if is_recorded(config.trials):
        return f"What has a recorded cloud was seen by a real camera, other objects, of {which},\nare seen"
    return f"The objects of {which} are seen"


def _measured(results: Mapping[str, Any], config: TrainConfig) -> str:
    return f"""\
{results["folds"]}-fold cross-validation over objects: success-rate (%) of the {config.N} highest-ranked grasps, with
its 95 % interval over objects. One seed ({config.seed}): other folds, noise and draws would move the rates, and are not
in the intervals. CG: all grasp types in one ranking. The model in this folder learned from all objects; these rates are
of its siblings in the folds.

Ranked as in the paper.{_other_data(config)}

{_rates(results, "paper", config)}

{KNOWS_MORE} Chosen was {chosen_words(results["chosen"])}.

{_rates(results, NESTED, config)}

Probabilities of success on the candidates of novel objects, beside those of a predictor that knows how often candidates
with and without a sensed collision succeed, and nothing else:

{_calibration(results)}"""


def _unmeasured(results: Mapping[str, Any], objects: int) -> str:
    known = "not calibrated" if objects == 1 else "calibrated on these objects alone, each held out once"
    return f"""\
Not measured: {results[NO_RATES]}. Its probabilities are {known}."""


def _dictionary(results: Mapping[str, Any]) -> str:
    """A paragraph where the prototypes are another model's."""
    about = results.get("prototypes_from")
    if about is None:
        return ""
    seen = {None: "what objects it knows is not known", 0: "it has seen none of the novel objects"}
    known = seen.get(about["seen"], f"it knows the shapes of {about['seen']} of the novel objects")
    return f"Its prototypes are those of a model of {about['hand']} (`{about['sha256'][:16]}`);\n{known}.\n\n"


def _other_data(config: TrainConfig) -> str:
    """What is to be said where the paper's rates stand beside ours."""
    return f" {paper.OTHER_DATA}" if paper.is_papers_hand(config.hand) else ""


def _rates(results: Mapping[str, Any], ranking: str, config: TrainConfig) -> str:
    """A Markdown table: a row a class; rates by a ranking with intervals, of its hand the paper's CG, and chance."""
    rates, intervals = results["by_ranking"][ranking], results["interval95_by_ranking"][ranking]
    printed, single = paper.SUCCESS_RATE.get(results["K"], {}), results["grasp_types"]
    papers, types = paper.is_papers_hand(config.hand), (*single, ALL)
    head = ["class", *types, *(["CG, the paper"] if papers else []), *(f"random {name}" for name in single)]
    rows = [f"| {' | '.join(head)} |", "|" + "---|" * len(head)]
    for name in (name for name in (*CLASSES, "all") if name in rates):
        cells = [
            f"{100 * rates[name][grasp_type]:.1f} ({100 * low:.0f}-{100 * high:.0f})"
            for grasp_type, (low, high) in ((each, intervals[name][each]) for each in types)
        ]
        if papers:
            cells.append(f"{printed[name][ALL]:.1f}" if name in printed else "-")
        cells += [f"{100 * results['random'][name][grasp_type]:.1f}" for grasp_type in single]
        rows.append(f"| {name} | " + " | ".join(cells) + " |")
    return "\n".join(rows)


def _calibration(results: Mapping[str, Any]) -> str:
    head, rows = score_table(results["calibration_free"], results["calibration"])
    return "\n".join("| " + " | ".join(row) + " |" for row in (head, ["---"] * len(head), *rows))
