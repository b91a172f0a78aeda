"""Checks of the open hand: limits, links that stand in each other, pads, and the TCP."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from itertools import combinations

import fcl
import numpy as np
import trimesh

from spgf_torch.handcheck.finding import Finding
from spgf_torch.handcheck.posed import Posed

BEYOND = 1e-3  # rad or m beyond a limit: rounding of degrees in a description, and of limits in URDFs
DEPTH = 0.002  # m that links may stand in each other: what convex pieces of meshes add
OFF_SURFACE = 0.001  # m between a pad and the surface of its link: what a clearance test would misjudge by
OFF_OPENING = 0.001  # m; the same of each half of an opening
ONE_SIDED = 0.25  # of the opening, where one jaw alone turns: its face leans, and its pad runs on a circle
TILT_DEG, ONE_SIDED_DEG = 5.0, 33.0  # deg of the line between two pads against the plane across the approach; the same
FACING_DEG = 30.0  # deg between a pad's face and the direction it closes in, of a jaw: friction 0.6 holds up to 31
ONE_SIDED_FACING_DEG = 65.0  # deg of a jaw that turns alone; wider, it squeezes things out (conf/hand/so101.yaml)
SPREAD_DEG = 75.0  # deg of the same for fingers that curl, whose faces turn while they close
LEAST_ROOM = 0.003  # m between the TCP and the nearest shape: half the thinnest opening that makes sense
OFF_MIDDLE = 0.25  # of the opening that the TCP may lie beside the middle of the pads
SAME_PADS = 0.005  # m between pads and where a turn by `symmetry` takes them: the jitter of candidates


def opened_findings(posed: Posed) -> Iterator[Finding]:
    """All checks of one open preshape."""
    yield _limits(posed)
    yield _self_contact(posed)
    yield _pad_surface(posed)
    if posed.preshape.jaw:
        yield _half_openings(posed)
        yield _level(posed)
    yield _facing(posed)
    yield from _tcp(posed)
    yield _symmetry(posed)


def _limits(posed: Posed) -> Finding:
    preshape, worst, least = posed.preshape, "", 0.0
    for values in (preshape.joints, preshape.closed):
        for name, joint in posed.kinematics.moving.items():
            beyond = max(joint.lower - values[name], values[name] - joint.upper)
            if beyond > least and joint.child not in posed.hand.robot.passive:
                worst, least = name, beyond
    return Finding(
        check="limits",
        preshape=posed.name,
        measured=f"{1000 * least:.1f} mrad or mm beyond" + (f" ({worst})" if worst else ""),
        expected=f"{1000 * BEYOND:g} at most",
        ok=least <= BEYOND,
        remedy="the URDF's limits do not reach: look at its <mimic> (sign, offset) and at parallel, hold and open",
    )


def _self_contact(posed: Posed) -> Finding:
    """How deep fingers stand in each other, or a tip in the palm. Links of one finger overlap in many URDFs."""
    depth, pair, fingers = 0.0, "", posed.fingers_of
    tips = {posed.bodies[link] for link in posed.carriers.values()}
    for (a, shapes_a), (b, shapes_b) in combinations(_bodies(posed).items(), 2):
        apart = fingers[a] != fingers[b]
        with_palm = "" in (fingers[a], fingers[b])
        if apart and (not with_palm or ({a, b} & tips and frozenset((a, b)) not in posed.joined)):
            found = _depth(shapes_a, shapes_b)
            if found > depth:
                depth, pair = found, f"{a} in {b}"
    return Finding(
        check="self-contact",
        preshape=posed.name,
        measured=f"{1000 * depth:.1f} mm deep" + (f" ({pair})" if pair else ""),
        expected=f"{1000 * DEPTH:g} mm at most",
        ok=depth <= DEPTH,
        remedy="these links push each other away: change hold, open or opening, or name a link under passive",
    )


def _bodies(posed: Posed) -> dict[str, list[trimesh.Trimesh]]:
    """Rigid body -> its shapes in the TCP frame; without those that are not simulated."""
    found: dict[str, list[trimesh.Trimesh]] = {}
    for link, shape in zip(posed.preshape.shape_links, posed.preshape.shapes, strict=True):
        if link not in posed.hand.robot.passive:
            found.setdefault(posed.bodies[link], []).append(shape)
    return found


def _depth(first: list[trimesh.Trimesh], second: list[trimesh.Trimesh]) -> float:
    """m that two sets of convex shapes overlap by at most."""
    request, deepest = fcl.CollisionRequest(num_max_contacts=1, enable_contact=True), 0.0
    for a in first:
        for b in second:
            if (a.bounds[1] > b.bounds[0]).all() and (b.bounds[1] > a.bounds[0]).all():
                result = fcl.CollisionResult()
                if fcl.collide(_convex(a), _convex(b), request, result):
                    deepest = max(deepest, *(abs(contact.penetration_depth) for contact in result.contacts))
    return deepest


def _convex(shape: trimesh.Trimesh) -> fcl.CollisionObject:
    faces = np.column_stack([np.full(len(shape.faces), 3), shape.faces]).astype(np.int32).ravel()
    return fcl.CollisionObject(fcl.Convex(np.asarray(shape.vertices, dtype=np.float64), len(shape.faces), faces))


def _pad_surface(posed: Posed) -> Finding:
    """The pad that is farthest from its link's shapes: outside them, or below their surface."""
    away = {name: posed.surface(name)[0] for name in posed.preshape.pads}
    worst = max(away, key=away.__getitem__)
    return Finding(
        check="pad on its link",
        preshape=posed.name,
        measured=f"{1000 * away[worst]:.2f} mm off the surface ({worst})",
        expected=f"{1000 * OFF_SURFACE:g} mm at most",
        ok=away[worst] <= OFF_SURFACE,
        remedy="pads are points in the frame of the finger's first link, m; leave pads out, and they are measured",
    )


def _half_openings(posed: Posed) -> Finding:
    """From the TCP along closing, both ways, to the first shape: half the opening each."""
    half, faces = posed.preshape.opening / 2, []
    for sign in (1.0, -1.0):
        faces.append(posed.free_way(np.array([sign, 0.0, 0.0])))
    worst = max(faces, key=lambda face: abs(face - half))
    most = ONE_SIDED * 2 * half if posed.one_sided else OFF_OPENING
    return Finding(
        check="free opening",
        preshape=posed.name,
        measured=f"{1000 * worst:.1f} mm from the TCP to a face" if np.isfinite(worst) else "no face beside the TCP",
        expected=f"half the opening, {1000 * half:.1f} mm, within {1000 * most:.1f} mm",
        ok=bool(abs(worst - half) <= most),
        remedy="the pads are not what closes, or a convex piece of a mesh fills the gap: see the picture",
    )


def _level(posed: Posed) -> Finding:
    pads, z = posed.preshape.pads, posed.preshape.T_base_tcp[:3, 2]
    first, second = (np.mean([pads[name] for name in group], axis=0) for group in posed.groups)
    line = second - first
    tilt = float(np.degrees(np.arcsin(np.clip(abs(line @ z) / max(np.linalg.norm(line), 1e-9), 0, 1))))
    most = ONE_SIDED_DEG if posed.one_sided else TILT_DEG
    return Finding(
        check="pads level",
        preshape=posed.name,
        measured=f"{tilt:.1f} deg, {1000 * abs(line @ z):.1f} mm",
        expected=f"{most:g} deg at most",
        ok=tilt <= most,
        remedy="one pad lies ahead of the other: look at approach, at the signs in close, and at <mimic>",
    )


def _facing(posed: Posed) -> Finding:
    most = SPREAD_DEG if not posed.preshape.jaw else ONE_SIDED_FACING_DEG if posed.one_sided else FACING_DEG
    angles = {}
    for name, inwards in posed.inwards.items():
        normal = posed.surface(name)[1]
        angles[name] = float(np.degrees(np.arccos(np.clip(normal @ inwards, -1, 1))))
    worst = max(angles, key=angles.__getitem__)
    return Finding(
        check="pads face",
        preshape=posed.name,
        measured=f"{angles[worst]:.0f} deg from what it closes on ({worst})",
        expected=f"{most:g} deg at most",
        ok=angles[worst] <= most,
        remedy="its face looks elsewhere: look at pads, oppose, and the joints that turn the finger",
    )


def _tcp(posed: Posed) -> Iterator[Finding]:
    """The TCP lies in the open, ahead of the palm, amid the pads."""
    of = partial(Finding, preshape=posed.name)
    ahead = posed.free_way(np.array([0.0, 0.0, 1.0]))
    yield of(
        check="TCP ahead of the palm",
        measured="nothing ahead of it" if np.isinf(ahead) else f"a shape {1000 * ahead:.0f} mm ahead of it",
        expected="nothing ahead of it along the approach",
        ok=bool(np.isinf(ahead)),
        remedy="approach points into the hand (its sign or axis), or tcp lies in the palm",
    )
    room = posed.room()
    yield of(
        check="TCP in the open",
        measured=f"{1000 * room:.1f} mm from the nearest shape",
        expected=f"{1000 * LEAST_ROOM:g} mm or more",
        ok=room >= LEAST_ROOM,
        remedy="tcp lies in a link or touches one: look at tcp, pads and opening",
    )
    T, pads = posed.preshape.T_base_tcp, posed.preshape.pads
    sides = [np.mean([pads[name] for name in group], axis=0) for group in posed.groups]
    off = float(np.linalg.norm(posed.across(np.mean(sides, axis=0) - T[:3, 3])))
    yield of(
        check="TCP amid the pads",
        measured=f"{1000 * off:.1f} mm beside their middle",
        expected=f"a quarter of the opening, {1000 * OFF_MIDDLE * posed.preshape.opening:.0f} mm, at most",
        ok=off <= OFF_MIDDLE * posed.preshape.opening,
        remedy="tcp is in the frame of root, m; leave it out, and it is measured",
    )


def _symmetry(posed: Posed) -> Finding:
    """Turned by a full turn over `symmetry`, the pads are where pads were."""
    T, turns = posed.preshape.T_base_tcp, posed.preshape.symmetry
    pads = (np.array(list(posed.preshape.pads.values())) - T[:3, 3]) @ T[:3, :3]
    turned = pads @ trimesh.transformations.rotation_matrix(2 * np.pi / turns, (0, 0, 1))[:3, :3].T
    away = float(np.linalg.norm(turned[:, None] - pads[None], axis=2).min(axis=1).max())
    return Finding(
        check="symmetry",
        preshape=posed.name,
        measured=f"pads {1000 * away:.1f} mm from pads after 1/{turns} of a turn",
        expected=f"{1000 * SAME_PADS:g} mm at most",
        ok=away <= SAME_PADS,
        remedy="the hand is another one after that turn: symmetry is 1 for a thumb against two fingers",
    )
