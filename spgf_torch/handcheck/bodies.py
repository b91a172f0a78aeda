"""Checks of the hand as a whole: size of its shapes, masses and inertias."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from xml.etree import ElementTree

import numpy as np

from spgf_torch.handcheck.finding import Finding
from spgf_torch.hands.hand import Hand

SMALLEST, LARGEST = 0.03, 1.0  # m across; a micro gripper's fingers, an excavator's: nothing that objects in m fit
LEAST_SHAPE = 0.001  # m; the thinnest finger plate. Less is a mesh in m that was scaled as if in mm
LIGHTEST = 1e-4  # kg of a link that moves
DENSEST = 1e5  # kg/m3 of a link's shapes; four times osmium, since shapes may leave most of a link out
WIDEST_GYRATION = 0.5  # m; radius of gyration of a link: as if its mass were on the far side of the largest hand


def body_findings(hand: Hand) -> Iterator[Finding]:
    """Size, masses and inertias of a hand."""
    of_hand = partial(Finding, preshape="")
    meshes = [(piece.link, np.ptp(piece.mesh.vertices, axis=0).max()) for piece in hand.robot.collisions]
    shapes = next(iter(hand.preshapes.values())).shapes
    points = np.concatenate([shape.vertices for shape in shapes])
    across = float(np.ptp(points, axis=0).max())
    yield of_hand(
        check="size",
        measured=f"{across:.3g} m",
        expected=f"{SMALLEST:g} to {LARGEST:g} m",
        ok=SMALLEST <= across <= LARGEST,
        remedy="meshes in mm need scale=0.001 in the URDF's <mesh>, and meshes in m none",
    )
    extents: dict[str, float] = {}
    for link, extent in meshes:
        extents[link] = max(extents.get(link, 0.0), float(extent))
    least = min(extents, key=extents.__getitem__)
    yield of_hand(
        check="smallest link",
        measured=f"{1000 * extents[least]:.3g} mm ({least})",
        expected=f"{1000 * LEAST_SHAPE:g} mm or more",
        ok=extents[least] >= LEAST_SHAPE,
        remedy="its mesh is scaled too often; look at scale in the URDF's <mesh>",
    )
    yield from _inertial_findings(hand)


def _inertial_findings(hand: Hand) -> Iterator[Finding]:
    """Masses of the links that move, and how far from its centre each link's inertia puts its mass."""
    moving = {joint.child for joint in hand.robot.joints if joint.moves} - hand.robot.passive
    turning = {joint.child for joint in hand.robot.joints if joint.moves and joint.kind != "prismatic"}
    masses, gyrations, volumes = {}, {}, _volumes(hand)
    for link in ElementTree.fromstring(hand.robot.xml).iter("link"):
        mass, inertia, name = link.find("inertial/mass"), link.find("inertial/inertia"), str(link.get("name"))
        if name in moving and mass is not None and inertia is not None:
            masses[name] = float(mass.get("value", 0))
            if name in turning:  # what slides does not turn: its inertia has no effect
                most = max(float(inertia.get(key, 0)) for key in ("ixx", "iyy", "izz"))
                gyrations[name] = float(np.sqrt(max(most, 0.0) / max(masses[name], 1e-12)))
    of_hand = partial(Finding, preshape="")
    if masses:
        densities = {name: mass / volumes[name] for name, mass in masses.items() if volumes.get(name)}
        light = min(masses, key=lambda name: masses[name])
        dense = max(densities, key=lambda name: densities[name], default=light)
        bad = light if masses[light] < LIGHTEST else dense
        yield of_hand(
            check="mass of links",
            measured=f"{masses[bad]:.3g} kg, {densities.get(bad, 0):.3g} kg/m3 ({bad})",
            expected=f"{LIGHTEST:g} kg or more, and {DENSEST:g} kg/m3 at most",
            ok=masses[light] >= LIGHTEST and densities.get(dense, 0) <= DENSEST,
            remedy="masses are in kg, not in g: look at the URDF's <inertial>",
        )
    if gyrations:
        widest = max(gyrations, key=lambda name: gyrations[name])
        yield of_hand(
            check="inertia of links",
            measured=f"{1000 * gyrations[widest]:.3g} mm ({widest})",
            expected=f"a radius of gyration of {1000 * WIDEST_GYRATION:g} mm at most",
            ok=gyrations[widest] <= WIDEST_GYRATION,
            remedy="inertias are in kg m2: g mm2 need a factor of 1e-9, kg mm2 one of 1e-6",
        )


def _volumes(hand: Hand) -> dict[str, float]:
    """Link -> m3 of its shapes."""
    volumes: dict[str, float] = {}
    for piece in hand.robot.collisions:
        volumes[piece.link] = volumes.get(piece.link, 0.0) + float(piece.mesh.volume)
    return volumes
