"""Parts of the report that come from a model: its prototypes (Figs. 10 and 11) and learned grasps (Figs. 12, 13)."""

from __future__ import annotations

import html
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import torch

from spgf_torch.affordance.model import GraspModel
from spgf_torch.drawing.page import Section, caption, drawn, picture, png, table, turning
from spgf_torch.drawing.style import prototype_colours
from spgf_torch.features.config import FeatureConfig
from spgf_torch.features.spgf import spgf
from spgf_torch.objects.config import CLASSES
from spgf_torch.objects.grasp_object import GraspObject
from spgf_torch.prototypes import naming as rule
from spgf_torch.prototypes.kmeans import assign
from spgf_torch.prototypes.naming import prototype_names, ring_shape
from spgf_torch.reporting.figures import scenes
from spgf_torch.reporting.figures.learned import Ring, learned_grasps, rings
from spgf_torch.reporting.figures.views import grasp_view, object_view, prototype_view
from spgf_torch.reporting.pages.context import Context, Part
from spgf_torch.sensing.config import SensingConfig
from spgf_torch.sensing.sense import sense
from spgf_torch.settings import typed

FIGURE = {"NPG": 12, "WPG": 13}
WORDS = {"NPG": "narrow pinch grasp", "WPG": "wide pinch grasp"}


@dataclass(frozen=True)
class Prototypes:
    """The prototypes of a model, named and drawn.

    Attributes:
        degrees: (K, 2, cells, 2) rings in degrees. shapes: of each prototype its top and bottom layer.
    """

    model: GraspModel
    degrees: np.ndarray
    names: list[str]
    colours: list[str]
    shapes: list[tuple[Ring, Ring]]


def describe(model: GraspModel, radius: float) -> Prototypes:
    """The model's prototypes; `radius` (m) of its features."""
    degrees = model.rings_deg()
    names = prototype_names(degrees)
    return Prototypes(model, degrees, names, prototype_colours(names), [rings(ring, radius) for ring in degrees])


def prototypes_part(context: Context, prototypes: Prototypes) -> Part:
    """Fig. 10, and the rule of the names."""
    shown_as = drawn(scenes.prototypes(prototypes.shapes, prototypes.names))
    words = caption(
        f"The {len(prototypes.names)} prototypes of K = {context.shown.K}. The centre looks up (black), "
        "red points in the aligned direction. A cell of a ring lies where its mean elevation alpha1 puts it at the "
        "feature's radius, and its colour is the angle alpha2 between its normal and the centre's: yellow none, "
        "teal a right angle, violet opposite. The bottom layer, of neighbours that face away, is drawn a little "
        "lower so that it is seen; grey dashes are gaps."
    )
    shapes = [ring_shape(ring) for ring in prototypes.degrees]
    rows = [
        [
            f'<span class="swatch" style="background:{colour}"></span>{html.escape(name)}',
            *(f"{100 * share:.0f}" for share in (shape.gap, shape.bottom, shape.other_side, shape.bend)),
            f"{shape.range_deg:.0f}",
            f"{shape.alpha1_deg:+.0f}",
        ]
        for name, colour, shape in zip(prototypes.names, prototypes.colours, shapes, strict=True)
    ]
    head = [
        "name",
        "gap",
        "bottom ring",
        "other side",
        "bends (% of the ring)",
        "range of alpha2",
        "alpha1 at the bend (deg)",
    ]
    text = html.escape((rule.__doc__ or "").strip())
    names = (
        "<h3>Names</h3><p>The name follows from the ring's values by a fixed rule; the number is the prototype's "
        f"id.</p><details><summary>The rule</summary><pre>{text}</pre></details><details><summary>The values it "
        f"looks at</summary>{table(head, rows)}</details>"
    )
    body = (
        words + picture(shown_as, "prototypes") + turning(prototype_view(prototypes.shapes, prototypes.names)) + names
    )
    return Part(Section("fig10", "Fig. 10: prototypes", body), {"fig10_prototypes.png": png(shown_as)})


def objects_part(context: Context, prototypes: Prototypes, library: Mapping[str, GraspObject]) -> Part:
    """Fig. 11: some objects as the run's own sensing and features see them."""
    settings = context.shown.settings
    sensing, features = typed(SensingConfig, settings["sensing"]), typed(FeatureConfig, settings["features"])
    shown = [
        _texels(obj, prototypes.model, sensing, features, context.shown.seed)
        for obj in some_objects(library, context.config.objects)
    ]
    shown_as = drawn(scenes.objects(shown, prototypes.names, prototypes.colours))
    words = caption(
        f"Objects as {sensing.cameras} depth cameras see them; each texlet has the colour of its nearest "
        f"prototype (K = {context.shown.K}). A name's family has a hue, its members have shades: grey surface, blue "
        "wall, orange rim, green edge, purple corner. In the view below a click on the legend hides a prototype, a "
        "double click shows it alone."
    )
    body = words + picture(shown_as, "objects") + turning(object_view(shown, prototypes.names, prototypes.colours))
    return Part(Section("fig11", "Fig. 11: objects", body), {"fig11_objects.png": png(shown_as)})


def grasps_part(context: Context, prototypes: Prototypes, kind: str, opening: float) -> Part:
    """Fig. 12 (NPG) or 13 (WPG)."""
    learned = [
        learned_grasps(prototypes.model, k, kind, opening, context.config.grasps) for k in range(len(prototypes.names))
    ]
    shown_as = drawn(scenes.grasps(prototypes.shapes, learned, prototypes.names, opening))
    points = sum(found.points for found in learned)
    words = caption(
        f"What was learned of the {WORDS[kind]} ({kind}), K = {context.shown.K}. Each "
        "prototype (grey) with hands where grasps of this type were tried near it, drawn at half their width: red, "
        f"they failed; green, they held. Of {points:,} learned points the picture shows {context.config.grasps} a "
        "prototype, from its best supported ones: one half spread over the most successful, the other over all."
    )
    body = (
        words
        + picture(shown_as, f"learned grasps {kind}")
        + turning(grasp_view(prototypes.shapes, learned, prototypes.names))
    )
    title = f"Fig. {FIGURE[kind]}: {kind}"
    return Part(Section(f"fig{FIGURE[kind]}", title, body), {f"fig{FIGURE[kind]}_{kind}.png": png(shown_as)})


def some_objects(library: Mapping[str, GraspObject], each: int) -> list[GraspObject]:
    """`each` objects of every class, evenly spaced in the order of names."""
    chosen = []
    for category in CLASSES:
        members = [obj for _, obj in sorted(library.items()) if obj.category == category]
        places = np.unique(np.linspace(0, len(members) - 1, min(each, len(members))).round().astype(int))
        chosen += [members[i] for i in places]
    return chosen


def _texels(
    obj: GraspObject, model: GraspModel, sensing: SensingConfig, features: FeatureConfig, seed: int
) -> scenes.Texlets:
    texlets = sense(obj, sensing, seed)
    found = spgf(texlets.positions, texlets.normals, features, torch.Generator().manual_seed(seed))
    ids = assign(found.relations(), model.centres)
    return scenes.Texlets(obj.name, texlets.positions.numpy(), texlets.normals.numpy(), ids.numpy())
