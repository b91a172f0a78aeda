"""The description of the server: held to the settings, to the routes, and to what is answered."""

import json
import re
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import pytest
from asymmetric import GRIPPERS, asymmetric
from serving_machines import Alone, alone, settings

from spgf_torch.formats.grasps_json import grasps_dict
from spgf_torch.serving.bodies import SETTINGS, value_of
from spgf_torch.serving.docs_page import docs_page
from spgf_torch.serving.openapi import openapi


@pytest.fixture(scope="module")
def described() -> Any:
    return openapi(settings(max_points=1234), {"voxel": "m; clouds <are> averaged"})


def test_it_lists_the_routes_that_there_are(described: Any, tmp_path: Path) -> None:
    with alone(tmp_path, quiet=True) as server:
        routes = {route.path: route.methods - {"HEAD"} for route in server.app.asgi._routes}
        assert {path: {way.upper() for way in ways} for path, ways in described["paths"].items()} == routes
        check_pages(server)


def check_pages(server: Alone) -> None:
    """`/openapi.json`, `/docs` and `/` are there, and name nothing that would have to be fetched elsewhere."""
    assert server.ask("GET", "/openapi.json").json["openapi"] == "3.1.0"
    for path in ("/docs", "/"):
        told = server.ask("GET", path)
        assert told.status == 200 and told.headers["content-type"].startswith("text/html")
        assert not re.findall(rb"(?:src|href)=[\"']?(?:https?:)?//|@import|url\(", told.body)


def test_settings_have_the_ranges_of_the_scene(described: Any) -> None:
    parameters = {each["name"]: each for each in described["paths"]["/grasps"]["post"]["parameters"]}
    assert set(parameters) == set(SETTINGS) and not {"input", "mask", "segments", "poses"} & set(parameters)
    assert parameters["voxel"]["schema"] | {"description": ""} == {
        "type": "number",
        "minimum": 0.0005,
        "maximum": 0.05,
        "description": "",
    }
    assert parameters["unit"]["schema"]["enum"] == ["m", "cm", "mm"]
    assert parameters["max_points"]["schema"]["maximum"] == 1234
    assert parameters["stride"]["schema"]["type"] == "integer"


def test_a_grasp_is_described_as_it_is_answered(described: Any) -> None:
    said = grasps_dict([asymmetric()], GRIPPERS, None)
    schemas = described["components"]["schemas"]
    grasp = said["grasps"][0]
    assert set(schemas["Grasp"]["required"]) <= set(grasp) <= set(schemas["Grasp"]["properties"])
    assert set(said) <= set(schemas["Grasps"]["properties"])
    kinds = {"string": str, "number": (int, float), "integer": int, "object": dict, "array": list}
    for name, value in grasp.items():
        if name in schemas["Grasp"]["properties"]:
            assert isinstance(value, kinds[schemas["Grasp"]["properties"][name]["type"]]), name
    references = set(re.findall(r'"#/components/schemas/(\w+)"', json.dumps(described)))
    assert references <= set(schemas)


class Tags(HTMLParser):
    """Which tags are open, and the text in cells."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.cells: list[str] = []

    def handle_starttag(self, tag: str, attrs: Any) -> None:
        if tag not in ("meta", "link", "p"):
            self.open.append(tag)
        if tag == "td":
            self.cells.append("")

    def handle_endtag(self, tag: str) -> None:
        if tag != "p":
            assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if "td" in self.open:
            self.cells[-1] += data


def test_the_page_says_all_of_it_and_closes_its_tags(described: Any) -> None:
    tags = Tags()
    tags.feed(docs_page(described))
    assert not tags.open
    assert set(SETTINGS) <= set(tags.cells) and "m; clouds <are> averaged" in tags.cells
    assert "number 0.0005 to 0.05" in tags.cells and "T_input_pregrasp" in tags.cells


@pytest.mark.parametrize(
    ("words", "value"),
    [
        ("1.05,-0.25,.45", [1.05, -0.25, 0.45]),
        ("-.5", -0.5),
        ("[[0, .25, 1e-3]]", [[0, 0.25, 0.001]]),
        ("0,0,1,-.03", [0, 0, 1, -0.03]),
        ("find", "find"),
        ("cloud.1.ply", "cloud.1.ply"),
        (".5.6", ".5.6"),
    ],
)
def test_a_value_in_an_address_is_read_as_the_command_reads_it(words: str, value: object) -> None:
    assert value_of(words) == value
