"""The OpenAPI description as a page without scripts, which needs no network.

Swagger UI in a package: swagger-ui-bundle has a version of 2022, which reads no OpenAPI 3.1; fastapi-offline has a new
one and wants FastAPI.
"""

from __future__ import annotations

import html
import json
from collections.abc import Iterator, Mapping
from importlib.resources import files
from typing import Any

_CURL = """curl --data-binary @mug.ply -H 'Content-Type: model/ply' 'ADDRESS/grasps?viewpoint=0,0,0&table=find'
curl -F input=@depth.png -F intrinsics=@camera_info.yaml -F table=find ADDRESS/grasps
curl -H 'Content-Type: application/json' -d '{"points": [...], "viewpoint": [0, 0, 0], "top": 5}' ADDRESS/grasps"""


def docs_page(described: Mapping[str, Any]) -> str:
    """The page of an OpenAPI description."""
    about = described["info"]
    style = files("spgf_torch.serving").joinpath("docs_page.css").read_text(encoding="utf-8")
    lines = [
        f'<!doctype html><html lang="en"><meta charset="utf-8"><title>{_text(about["title"])}</title>',
        '<link rel="icon" href="data:,">',
        f'<meta name="viewport" content="width=device-width"><style>{style}</style>',
        f"<h1>{_text(about['title'])} {_text(about['version'])}</h1>",
        '<p><a href="openapi.json">openapi.json</a> for programs, <a href=".">the form</a> for a file.</p>',
        f"<pre>{_text(_CURL)}</pre>",
    ]
    for path, ways in described["paths"].items():
        for way, told in ways.items():
            lines += _operation(path, way, told)
    for name, schema in described["components"]["schemas"].items():
        lines += [f'<h2 id="{_text(name)}">{_text(name)}</h2>', *_table(schema.get("properties", {}))]
    return "\n".join(lines) + "</html>\n"


def _operation(path: str, way: str, told: Mapping[str, Any]) -> Iterator[str]:
    yield f'<h2><span class="way">{way.upper()}</span> {_text(path)}</h2><p>{_text(told["summary"])}.'
    yield f"{_text(told.get('description', ''))}</p>"
    if parameters := told.get("parameters"):
        yield "<h3>Parameters</h3>"
        yield from _table({each["name"]: each["schema"] | {"description": each["description"]} for each in parameters})
    for kind, body in told.get("requestBody", {}).get("content", {}).items():
        properties = body["schema"].get("properties", {})
        own = {name: schema for name, schema in properties.items() if name not in {p["name"] for p in parameters or ()}}
        yield f"<h3>Body: <code>{_text(kind)}</code></h3>"
        yield from _table(own)
        if "example" in body:
            yield f"<pre>{_text(json.dumps(body['example']))}</pre>"
    yield "<h3>Answers</h3><table>"
    for status, answer in told["responses"].items():
        yield f"<tr><td><code>{status}</code></td><td>{_text(answer['description'])} {_named(answer)}</td></tr>"
    yield "</table>"


def _table(properties: Mapping[str, Mapping[str, Any]]) -> Iterator[str]:
    if not properties:
        return
    yield "<table>"
    for name, schema in properties.items():
        words = _text(schema.get("description", ""))
        yield f"<tr><td><code>{_text(name)}</code></td><td>{_kind(schema)}</td><td>{words}</td></tr>"
    yield "</table>"


def _kind(schema: Mapping[str, Any]) -> str:
    """What values there may be, in words."""
    if "$ref" in schema:
        return _link(schema["$ref"])
    if "enum" in schema:
        return _text(", ".join(schema["enum"]))
    kind = schema.get("type", "")
    words = " or ".join(kind) if isinstance(kind, list) else kind
    if "minimum" in schema and "maximum" in schema:
        words += f" {schema['minimum']:g} to {schema['maximum']:g}"
    return _text(words) + (f" of {_kind(schema['items'])}" if "$ref" in schema.get("items", {}) else "")


def _named(answer: Mapping[str, Any]) -> str:
    schemas = [body["schema"] for body in answer.get("content", {}).values()]
    return "".join(_link(schema["$ref"]) for schema in schemas if "$ref" in schema)


def _link(reference: str) -> str:
    name = reference.rpartition("/")[2]
    return f'<a href="#{_text(name)}">{_text(name)}</a>'


def _text(words: str) -> str:
    return html.escape(words)
