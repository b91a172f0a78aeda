"""Parts of the report that come from a model: its prototypes (Figs. 10 and 11) and learned grasps (Figs. 12, 13)."""

from __future__ import annotations

import html

from spgf_torch.drawing.page import Section, caption, drawn, picture, png, table, turning
from spgf_torch.objects.grasp_object import GraspObject
from spgf_torch.prototypes import naming as rule
from spgf_torch.prototypes.naming import ring_shape
from spgf_torch.reporting.figures import scenes
from spgf_torch.reporting.figures.learned import best_percent, learned_grasps, short_outline
from spgf_torch.reporting.figures.views import grasp_view, object_view, prototype_view
from spgf_torch.reporting.pages.context import Context, Part
from spgf_torch.reporting.pages.pictured import Pictured, some_objects

FIGURE = {"NPG": 12, "WPG": 13}  # of the paper, which has these two types
WORDS = {"NPG": "narrow pinch grasp", "WPG": "wide pinch grasp"}
BEST = 3  # prototypes that the text names


def prototypes_part(shown: Pictured) -> Part:
    """Fig. 10, and the rule of the names."""
    shown_as = drawn(scenes.prototypes(shown.looks))
    words = caption(
        f"The prototypes of {shown.whose}. The square in the centre has the prototype's colour in Fig. 11. Its frame: "
        "black the normal, red the aligned direction. A cell of a ring lies where the mean alpha1 of the features that "
        "have something there puts it at the feature's radius; its colour is their mean alpha2, the angle between its "
        "normal and the centre's: yellow none, teal a right angle, violet opposite. It is as wide as their share; "
        "where more than half of the features have a gap, so has the picture (grey dashes). The bottom layer, of "
        "neighbours that face away, is drawn a little lower so that it is seen."
    )
    body = words + picture(shown_as, "prototypes") + turning(prototype_view(shown.looks)) + _names(shown)
    return Part(Section("fig10", "Fig. 10: prototypes", body), {"fig10_prototypes.png": png(shown_as)})


def objects_part(context: Context, shown: Pictured, library: dict[str, GraspObject]) -> Part:
    """Fig. 11: some novel objects as the run's own sensing and features see them."""
    chosen = some_objects(shown.novel or list(library.values()), context.config.objects)
    inferred = [shown.inferred(obj) for obj in chosen]
    shown_as = drawn(scenes.objects(inferred, shown.looks))
    which = f"Novel objects of fold {shown.fold}" if shown.novel else "Objects that the model was learned from"
    words = caption(
        f"{which}, as {shown.eyes.sensing.cameras} depth cameras see them, each drawn to a scale of its own. A texlet "
        f"(a square 4.8 mm wide) has the colour of its nearest prototype in {shown.whose}: the centres of Fig. 10. In "
        "the view below a click on the legend hides a prototype, a double click shows it alone."
    )
    body = words + picture(shown_as, "objects") + turning(object_view(inferred, shown.looks))
    return Part(Section("fig11", "Fig. 11: objects", body), {"fig11_objects.png": png(shown_as)})


def grasps_part(context: Context, shown: Pictured, kind: str) -> Part:
    """Fig. 12 (NPG) or 13 (WPG), and the same of types that have other names."""
    gripper = shown.grippers[kind]
    name, title = (
        (f"fig{FIGURE[kind]}", f"Fig. {FIGURE[kind]}: {kind}") if kind in FIGURE else (kind, f"Learned: {kind}")
    )
    reach = float(shown.run.settings["affordance"]["reach"])
    learned = [
        learned_grasps(shown.model, k, kind, short_outline(gripper), context.config.grasps)
        for k in range(len(shown.looks))
    ]
    shown_as = drawn(scenes.grasps(shown.looks, learned, gripper))
    words_for = f"the {WORDS[kind]} ({kind})" if kind in WORDS else f"the grasp type {html.escape(kind)}"
    true = "at true width (but a third of their length)" if gripper.jaw else "as outlines"
    points = sum(found.points for found in learned)
    words = caption(
        f"What {shown.whose}, learned of {words_for}: each prototype alone, and in grey with hands "
        f"{true} where grasps were tried up to {1000 * reach:.0f} mm away: red, they "
        f"failed; green, they held. Of {points:,} learned points the picture shows {context.config.grasps} a "
        "prototype, from its best supported ones: one half spread over the most successful, the other over all. "
        + _most_reliable(shown, kind)
    )
    body = words + picture(shown_as, f"learned grasps {kind}") + turning(grasp_view(shown.looks, learned))
    file = f"{name}_{kind}.png" if kind in FIGURE else f"learned_{kind}.png"
    return Part(Section(name, title, body), {file: png(shown_as)})


def _most_reliable(shown: Pictured, kind: str) -> str:
    """Which prototypes predict best, as a sentence."""
    best = [best_percent(shown.model, k, kind) for k in range(len(shown.looks))]
    order = sorted(range(len(best)), key=lambda k: -best[k])[:BEST]
    told = ", ".join(f"{html.escape(shown.looks[k].name)} {best[k]:.2f}" for k in order)
    base = float(shown.model.condensed.base_rate[shown.model.grasp_types.index(kind)])
    return (
        f"The mean probability of the most successful hundredth of a prototype's points is highest for {told}, lowest "
        f"{min(best):.2f}; {base:.2f} of all particles held."
    )


def _names(shown: Pictured) -> str:
    """The rule of the names and the values that it looks at, as HTML."""
    rows = []
    for look, degrees in zip(shown.looks, shown.degrees, strict=True):
        shape = ring_shape(degrees)
        values = (100 * shape.gap, 100 * shape.other_side, shape.least_deg, shape.range_deg)
        name = f'<span class="swatch" style="background:{look.colour}"></span>{html.escape(look.name)}'
        rows.append([name, *(f"{value:.0f}" for value in values), f"{shape.alpha1_deg:+.0f}", look.note])
    head = ["name", "gap (%)", "other side (%)", "least alpha2", "range of alpha2", "alpha1 at the bend (deg)", ""]
    text = html.escape((rule.__doc__ or "").strip())
    return (
        "<h3>Names</h3><p>The name follows from the ring's values by a fixed rule; the number is the prototype's "
        f"id.</p><details><summary>The rule</summary><pre>{text}</pre></details><details><summary>The values it "
        f"looks at</summary>{table(head, rows)}</details>"
    )
