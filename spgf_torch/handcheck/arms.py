"""Whether a URDF is of an arm with a hand at its end, told from its joints alone: meshes need not be there."""

from __future__ import annotations

from xml.etree.ElementTree import Element

from spgf_torch.errors import InputError
from spgf_torch.hands.config import HandConfig
from spgf_torch.hands.urdf_files import urdf_root

LONGEST = 2  # joints in a row from the root that may be a single finger's, or a wrist's that belongs to the hand


def check_no_arm(config: HandConfig) -> None:
    """InputError that says which link the hand probably begins with, where many joints in a row lead to it."""
    if config.root is not None:
        return
    path, xml = urdf_root(config)
    joints = [(_link(joint, "parent"), _link(joint, "child"), joint.get("type")) for joint in xml.findall("joint")]
    body: dict[str, str] = {}
    links = [str(link.get("name")) for link in xml.findall("link")]
    fixed = {child: parent for parent, child, kind in joints if kind == "fixed"}
    for link in links:
        top = link
        for _ in range(len(links)):
            top = fixed.get(top, top)
        body[link] = top
    moving = [(body.get(parent, parent), child) for parent, child, kind in joints if kind != "fixed"]
    ends = {child for _, child in moving}
    at = next((body[link] for link in links if body[link] not in ends), "")
    row = [at]
    while len(below := [child for parent, child in moving if parent == at]) == 1 and len(row) <= len(links):
        at = below[0]
        row.append(at)
    # A row that ends in a single link ends in a jaw, which belongs to the link before it.
    branch = row[-1] if below else row[-2] if len(row) > 1 else row[0]
    count = row.index(branch)
    if count > LONGEST:
        near = [link for link in links if body[link] == branch and link != branch]
        beside = f"; fixed to that: {', '.join(near)}" if near else ""
        raise InputError(
            f"{path}: expected a hand, got {count} joints in a row, as of an arm; root={branch} takes what is at its "
            f"end{beside}"
        )


def _link(joint: Element, role: str) -> str:
    element = joint.find(role)
    return str(element.get("link")) if element is not None else ""
