"""Parts of the report that come from single grasps: precision at N, reliability, the worst objects."""

from __future__ import annotations

import html
from collections.abc import Mapping, Sequence

import numpy as np

from spgf_torch.drawing.outline import outline_words
from spgf_torch.drawing.page import Section, caption, chart, drawn, picture, png, table, turning
from spgf_torch.evaluation.predictions import Predictions
from spgf_torch.evaluation.reliability import BINS, Reliability, predicted, reliability, score_table
from spgf_torch.evaluation.success import ALL
from spgf_torch.hands.records import Gripper
from spgf_torch.objects.grasp_object import GraspObject
from spgf_torch.reporting.data.predictions import (
    ceilings_at,
    class_curves,
    mean_curves,
    precision_at,
)
from spgf_torch.reporting.figures.charts import FEW, Precision, precision_at_n, reliability_diagram
from spgf_torch.reporting.figures.learned import deep_outline
from spgf_torch.reporting.figures.scenes import Held, worst
from spgf_torch.reporting.figures.views import worst_view
from spgf_torch.reporting.pages.context import Context, Part
from spgf_torch.reporting.pages.table1 import HEADINGS


def precision_part(context: Context, objects: Sequence[Predictions]) -> Part:
    """Precision at N."""
    config, run = context.config, context.shown
    classes = [predictions.category for predictions in objects]

    def at(ranking: str) -> np.ndarray:
        return precision_at(objects, ranking, run.types, config.precision)

    second = context.second if all(context.second in predictions.scores for predictions in objects) else None
    curves = Precision(
        (context.ranking, second or ""),
        run.types,
        class_curves(classes, at(context.ranking), config.bootstrap, config.seed),
        mean_curves(classes, at(second)) if second else None,
        mean_curves(classes, ceilings_at(objects, run.types, config.precision)),
    )
    figure = precision_at_n(curves, run.N, run.random)
    words = caption(
        f"Share of successes among the N highest-ranked grasps, K = {run.K}, seed {run.seed} alone. Coloured: the "
        f"ranking <code>{html.escape(context.ranking)}</code> with its 95 % interval over objects"
        f"{f'; dotted: the same votes ranked by <code>{html.escape(second)}</code>' if second else ''}; grey dots: the "
        "ceiling, which falls where an object has fewer than N grasps that hold; dashed: random. The thin line marks "
        f"N = {run.N}, the N of Table 1."
    )
    body = words + chart(figure, "precision at N")
    return Part(Section("precision", "Precision at N", body), {"precision_at_n.png": png(drawn(figure))})


def reliability_part(context: Context, objects: Sequence[Predictions]) -> Part:
    """Reliability before and after calibration, and of a predictor that knows the collision flag alone."""
    curves: dict[str, dict[str, Reliability]] = {}
    for code, grasp_type in enumerate(context.shown.grasp_types):
        of_predictor, success = predicted(objects, code, free=True)
        curves[grasp_type] = {end: reliability(probability, success) for end, probability in of_predictor.items()}
    figure = reliability_diagram(curves)
    words = caption(
        f"What is predicted and what happens, on novel objects, K = {context.shown.K}: candidate grasps without a "
        f"sensed collision in {BINS} bins of predicted probability. On the dashed line, of the grasps that are given "
        "70 % exactly 70 % succeed. Grey: the mean learned probability of a grasp's votes; coloured: calibrated inside "
        "the training folds, with a curve that may be level below a score which they choose; diamonds: a predictor "
        "that knows the collision flag alone, from the training folds, and gives all these grasps the same. Hollow "
        f"points stand for fewer than {FEW} grasps; below, the number of grasps in each bin (logarithmic). Of all "
        "candidates the flag tells most: nearly none with a sensed collision succeeds, and a predictor needs no votes "
        "to know that. So the table has both."
    )
    head, rows = score_table(context.shown.calibration_free, context.shown.calibration)
    body = words + chart(figure, "reliability diagram") + (table(head, rows) if rows else "")
    return Part(Section("reliability", "Reliability", body), {"reliability.png": png(drawn(figure))})


def worst_part(
    context: Context,
    objects: Sequence[Predictions],
    library: Mapping[str, GraspObject],
    grippers: Mapping[str, Gripper],
) -> Part:
    """The objects with the fewest successes among their highest-ranked grasps, pictured."""
    n = context.shown.N
    tops = [(o, o.ranked(context.ranking, ALL, n)) for o in objects]
    failing = [(o, top) for o, top in tops if not o.success[top].all()]
    failing.sort(key=lambda pair: (pair[0].success[pair[1]].mean(), pair[0].name))
    if absent := [o.name for o, _ in failing if o.name not in library]:
        context.tell(f"worst objects: expected descriptions of {', '.join(absent)}, got none; not pictured")
    pictured = [pair for pair in failing if pair[0].name in library][: context.config.worst]
    title = "Worst objects"
    if not pictured:
        return Part(Section("worst", title, "<p>No object to picture: every highest-ranked grasp was held.</p>"))
    sticks = [deep_outline(grippers[name]) for name in context.shown.grasp_types]
    shown = [_held(o, top, library[o.name], sticks) for o, top in pictured]
    shown_as = drawn(worst(shown, HEADINGS.get(context.ranking, f"the ranking {context.ranking}")))
    words = caption(
        f"The objects with the lowest CG by the ranking <code>{html.escape(context.ranking)}</code>, K = "
        f"{context.shown.K}, with their {n} highest-ranked grasps: red failed, green held. {outline_words(grippers)} "
        "Turned below."
    )
    body = words + picture(shown_as, "worst objects") + turning(worst_view(shown))
    return Part(Section("worst", title, body), {"worst_objects.png": png(shown_as)})


def _held(predictions: Predictions, top: np.ndarray, obj: GraspObject, sticks: Sequence[np.ndarray]) -> Held:
    open_hands = [sticks[code] for code in predictions.grasp_type[top]]
    return Held.of(predictions.name, obj.mesh, predictions.T_object_tcp[top], open_hands, predictions.success[top])
