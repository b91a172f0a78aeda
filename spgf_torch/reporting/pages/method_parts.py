"""Parts of the report that show the method on real data: Figs. 1 to 8."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure
from PIL import Image

from spgf_torch.drawing.page import Section, caption, drawn, picture, png
from spgf_torch.errors import InputError
from spgf_torch.evaluation.predictions import Predictions
from spgf_torch.features.spgf import Features
from spgf_torch.objects.config import CLASSES
from spgf_torch.objects.grasp_object import GraspObject
from spgf_torch.paths import find
from spgf_torch.reporting.figures.example import Steps, Surroundings, telling_feature
from spgf_torch.reporting.figures.grid_figures import alignment_figure, average_figure, grid_figure
from spgf_torch.reporting.figures.learned import deep_outline, learned_grasps, short_outline
from spgf_torch.reporting.figures.overview import Overview, overview
from spgf_torch.reporting.figures.scenes import ABOVE, Inferred
from spgf_torch.reporting.figures.setup_figure import Tried, setup_figure
from spgf_torch.reporting.figures.space_figures import Linked, PairDrawn, angle_figure, link_figure
from spgf_torch.reporting.pages.context import Context, Part
from spgf_torch.reporting.pages.pictured import Pictured
from spgf_torch.sensing.cameras import surround
from spgf_torch.sensing.texlets import Texlets

KIND = "NPG"  # the type of grasp in Figs. 1, 6 and 7, as in the paper's Fig. 7b; of other hands the first
APART = 0.05  # m between feature and grasp in Fig. 6, about: T is seen, and the feature still has to do with it
SHEET = "contact_sheet.png"
WHAT = {
    2: "Fig. 2: the angles of the pair whose three angles are all well seen: alpha1 from the centre's plane to the "
    "neighbour (Eq. 2), alpha2 between the normals (Eq. 3), alpha3 around the centre's normal from R_x (Eq. 4).",
    3: "Fig. 3: a layer of the grid; six neighbours of that pair's centre, projected on its plane and put into cells.",
    4: "Fig. 4: the weighted moving average. (a) A cell's neighbours count by their distance; the cells M-2 and M+2 "
    "alike, so that their mean is what M gets where it is empty. (b) The feature of Fig. 1: each cell with data (bar) "
    "and the weights it has in the cells around; below, the layer before and after. What no weight reaches is a gap.",
    5: "Fig. 5: alignment. (a) From R_x, arbitrary in the paper, here towards the mean of the neighbours. (b) The cell "
    "with the largest alpha2 of the top layer (of equals the middle of the widest run) becomes the start of both "
    "layers; a gap counts as 90 deg.",
}


@dataclass(frozen=True)
class Example:
    """An object and one of its features, as the figures of the method show them."""

    obj: GraspObject
    texlets: Texlets
    found: Features
    chosen: int
    around: Surroundings
    steps: Steps
    inferred: Inferred


def example(shown: Pictured, library: Mapping[str, GraspObject], candidates: Sequence[Predictions]) -> Example:
    """The smallest container that the model has not seen and that was tried, or else what there is, and a feature.

    Raises InputError where features are none that the figures could draw.
    """
    if shown.model.descriptor != "spgf" or shown.eyes.features.gaps != "saturated":
        raise InputError("features: expected SPGF with saturated gaps for Figs. 1 to 6, got others")
    objects, tried = shown.novel or list(library.values()), {each.name for each in candidates}
    objects = [each for each in objects if each.name in tried] or objects
    obj = min(objects, key=lambda each: (CLASSES.index(each.category), float(np.prod(each.mesh.extents))))
    texlets, found = shown.eyes.see(obj)
    chosen = telling_feature(found, texlets.normals.numpy(), ABOVE)
    around = Surroundings.of(texlets, shown.eyes.features.radius)
    steps = Steps.of(around, chosen, shown.eyes.features)
    return Example(obj, texlets, found, chosen, around, steps, shown.inferred(obj))


def overview_part(context: Context, shown: Pictured, given: Example) -> Part:
    """Fig. 1."""
    own = int(given.inferred.ids[given.chosen])
    gripper = shown.grippers[_kind(shown)]
    learned = learned_grasps(shown.model, own, gripper.type, short_outline(gripper), context.config.grasps)
    figure = overview(Overview(given.inferred, given.steps, shown.looks, own, learned), shown.eyes.features.radius)
    words = (
        f"From an object ({_name(given.obj)}) to features that know of grasps. (a) Its texlets, with a chosen one "
        "(red) and its neighbours within the radius (blue). (b) Both alone; light blue faces the other way. (c) A "
        "relation to each neighbour. (d) Two circular grids, above for normals on the centre's side, below for the "
        "others; white cells are empty. (e) Unfolded. (f) The moving average fills what sampling left empty; hatched: "
        "gaps. (g) Aligned to the highest curvature. (h) k-means prototypes. (i) What was learned of "
        f"{shown.looks[own].name}, the prototype of this feature ({gripper.type}; red 0 to green 1). (j) The object's "
        f"inferred prototypes, in their colours; {shown.whose}."
    )
    return _part("fig1", "Fig. 1: overview", {"fig01_overview.png": (figure, words)})


def steps_part(shown: Pictured, given: Example, candidates: Sequence[Predictions]) -> Part:
    """Figs. 2 to 6; the last where the run's grasps can be read."""
    features = shown.eyes.features
    centre, pair = given.around.telling_pair(features.radius)
    other = Steps.of(given.around, centre, features)
    figures = {
        2: angle_figure(PairDrawn.of(given.around, centre, pair), features.radius),
        3: grid_figure(other, features.radius),
        4: average_figure(given.steps),
        5: alignment_figure(given.steps),
    }
    names = {2: "angles", 3: "grid", 4: "moving_average", 5: "alignment"}
    parts = {f"fig0{i}_{names[i]}.png": (figure, WHAT[i]) for i, figure in figures.items()}
    if (tried := _of(candidates, given.obj)) is not None:
        linked = link(shown, given, tried)
        words = (
            "Fig. 6: a shape-grasp particle links the feature of Fig. 1 and a trial: the grasp's pose in the feature's "
            "frame, how it ended, and the id of the feature's prototype. Red, green, black: x, y, z of both frames."
        )
        parts["fig06_transformation.png"] = (link_figure(linked, ABOVE), words)
    return _part("fig2", "Figs. 2 to 6: the steps", parts)


def link(shown: Pictured, given: Example, tried: Predictions) -> Linked:
    """The feature and a trial of the type `_kind` about `APART` from it, one that held if any did."""
    feature = given.steps.T_object_feature
    apart = np.abs(np.linalg.norm(tried.pose[:, :3] - feature[:3, 3], axis=1) - APART)
    grasp_types = shown.model.grasp_types
    wrong = tried.grasp_type != grasp_types.index(_kind(shown))
    best = int(np.lexsort((apart, ~tried.success, wrong))[0])
    look = shown.looks[int(given.inferred.ids[given.chosen])]
    gripper = shown.grippers[grasp_types[tried.grasp_type[best]]]
    inferred = given.inferred
    return Linked(
        inferred.positions,
        inferred.normals,
        feature,
        tried.T_object_tcp[best],
        look,
        deep_outline(gripper),
        bool(tried.success[best]),
    )


def setup_part(shown: Pictured, given: Example, candidates: Sequence[Predictions]) -> Part:
    """Fig. 7. Raises InputError without trials on the object."""
    if (tried := _of(candidates, given.obj)) is None:
        raise InputError(f"Fig. 7: expected predictions on {given.obj.name}, got none")
    cameras = surround(shown.eyes.sensing, given.obj.mesh.bounds.mean(axis=0))
    kind, hands = _kind(shown), [shown.grippers[name] for name in reversed(shown.model.grasp_types)]
    of_kind = tried.grasp_type == shown.model.grasp_types.index(kind)
    columns = (column[of_kind] for column in (tried.T_object_tcp, tried.success, tried.collides))
    trials = Tried(shown.grippers[kind], *columns)
    letters = ", ".join(f"({chr(ord('c') + i)})" for i in range(len(hands)))
    words = (
        f"(a) {len(cameras)} RGB-D cameras around the object, {shown.eyes.sensing.distance:g} m from its centre (x "
        f"red, y green, z, where it looks, black). (b) Some of the {int(of_kind.sum())} trials of {kind} on "
        f"{_name(given.obj)}, as many of each outcome: in truth {100 * trials.success.mean():.0f} % held. {letters} "
        "The hand's collision shapes, open for each type of grasp."
    )
    figure = setup_figure(given.obj.mesh, cameras, trials, hands)
    return _part("fig7", "Fig. 7: set-up", {"fig07_setup.png": (figure, words)})


def sheet_part(shown: Pictured) -> Part:
    """Fig. 8: the objects, as `python -m spgf_torch.objects.contact_sheet` drew them. Raises InputError without it."""
    path = find(shown.run.settings["objects"]) / SHEET
    if not path.is_file():
        raise InputError(f"Fig. 8: expected {path}, got no such file")
    with Image.open(path) as image:
        shown_as = image.convert("RGB")
    return Part(Section("fig8", "Fig. 8: all objects", caption("The objects by class.") + picture(shown_as, "objects")))


def _part(id: str, title: str, figures: Mapping[str, tuple[Figure, str]]) -> Part:
    """A section of figures by file name, each with its words."""
    images = {name: (drawn(figure), words) for name, (figure, words) in figures.items()}
    body = "".join(caption(words) + picture(image, name) for name, (image, words) in images.items())
    return Part(Section(id, title, body), {name: png(image) for name, (image, _) in images.items()})


def _of(candidates: Sequence[Predictions], obj: GraspObject) -> Predictions | None:
    return next((each for each in candidates if each.name == obj.name), None)


def _kind(shown: Pictured) -> str:
    """The type of grasp that is shown where there is room for one."""
    return KIND if KIND in shown.grippers else shown.model.grasp_types[0]


def _name(obj: GraspObject) -> str:
    return obj.name.replace("_", " ")
