"""The description of the server in OpenAPI 3.1, made from the settings' dataclasses and the comments in conf/."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from typing import Any, get_args, get_type_hints

from spgf_torch import __version__
from spgf_torch.scene.config import SceneConfig
from spgf_torch.serving.bodies import FILES, MULTIPART, SETTINGS, TYPES
from spgf_torch.serving.config import ServeConfig

Schema = dict[str, Any]

_POSE = {
    "type": "array",
    "minItems": 4,
    "maxItems": 4,
    "items": {"type": "array", "minItems": 4, "maxItems": 4, "items": {"type": "number"}},
    "description": "4 x 4, rows first, lengths in m, in the frame of what was sent",
}
_JOINTS = {"type": "object", "additionalProperties": {"type": "number"}, "description": "joint -> rad or m"}
_GRASP: Schema = {
    "type": {"type": "string", "description": "grasp type of the hand"},
    "probability": {"type": "number", "minimum": 0, "maximum": 1, "description": "that it holds"},
    "support": {"type": "integer", "description": "votes for it"},
    "target": {"type": "integer", "description": "number of what it grasps, of `segments`; else 1"},
    "score": {"type": "number", "description": "what ranks"},
    "gripper": {"type": "string"},
    "width": {"type": "number", "description": "m between the pads of the open hand"},
    "T_input_tcp": _POSE,
    "T_input_base": _POSE,
    "T_input_pregrasp": _POSE,
    "joints": _JOINTS,
    "closed": _JOINTS,
    "voted_by": {"type": "array", "items": {"type": "object"}},
}
_JUDGED = {"type": "object", "description": "P(free), and P(holds | free), where a judge ranked"}
_MODEL = {
    "type": "object",
    "properties": {
        **{name: {"type": "string"} for name in ("name", "hand", "ranked_by", "version")},
        "types": {"type": "array", "items": {"type": "string"}},
        "digest": {
            "type": "object",
            "description": "SHA-256 of its files",
            "additionalProperties": {"type": "string"},
        },
    },
}
_ROWS = {"type": "array", "items": {}}
_BODIES = {
    "points": {**_ROWS, "description": "(N, 3) or (H, W, 3), m or `unit`; null, NaN and 0 0 0: no reading"},
    "normals": {**_ROWS, "description": "in the shape of the points, of length 1, out of the surface"},
    "viewpoints": {**_ROWS, "description": "[x, y, z] or several, m: where it was seen from"},
    "depth": {**_ROWS, "description": "(H, W): fractions are m (or `unit`), whole numbers counts of `depth_scale`"},
    "K": {**_ROWS, "description": "3 x 3 in pixels, or [fx, fy, cx, cy]"},
    "T_input_camera": {**_POSE, "description": "the camera's pose; without it the frame is the camera's"},
    "mask": {**_ROWS, "description": "in the shape of points or pixels, not 0: the target"},
    "segments": {**_ROWS, "description": "the same with numbers, each above 0 a target of its own"},
}
_EXAMPLE = {"points": [[0.4, 0.1, 0.02], [0.4, 0.102, 0.02]], "viewpoint": [0, 0, 1], "table": [0, 0, 1, 0], "top": 5}
_ERRORS = {
    400: "what was sent cannot be used; the line names it, what was expected and what was got",
    403: "asked by another name, or by a page of another site",
    408: "the body did not come in time (body_seconds)",
    413: "the body is larger than largest_mb, or takes more memory than memory_gb",
    415: "no such kind of body is read",
    500: "the prediction ended its process, or the server has a defect",
    503: "the model is being loaded, or at_once requests are there already; Retry-After says when to ask again",
    504: "the prediction took longer than `seconds`, and was ended",
}


def openapi(config: ServeConfig, reasons: Mapping[str, str]) -> Schema:
    """The description of a server with these settings.

    Args:
        reasons: key of conf/scene -> what it means.
    """
    error = {"application/json": {"schema": {"$ref": "#/components/schemas/Error"}}}
    errors = {str(status): {"description": words, "content": error} for status, words in _ERRORS.items()}
    grasps = {
        "summary": "Grasps on a cloud, a depth image or a mesh",
        "description": f"At most {config.largest_mb:g} MB and {config.max_points} points or pixels. Settings of the "
        "scene are in the address, in the fields of a form, or in the JSON object; files are parts of a form.",
        "parameters": [
            {"name": name, "in": "query", "required": False, "schema": schema, "description": schema["description"]}
            for name, schema in _settings(config, reasons).items()
        ],
        "requestBody": {"required": True, "content": _content(config, reasons)},
        "responses": {"200": _json("Grasps", "ranked grasps, best first"), **errors},
    }
    html = {"200": {"description": "HTML", "content": {"text/html": {"schema": {"type": "string"}}}}}
    named = {"name": "name", "in": "path", "required": True, "schema": {"type": "string"}}
    lost = {"404": {"description": f"not one of the latest {config.kept} results", "content": error}}
    paths = {
        "/grasps": {"post": grasps},
        "/results/{name}/page": {
            "get": {
                "summary": "The page of a result: its `id`, or last",
                "parameters": [{**named, "description": "`id` of an answer, or last"}],
                "responses": {**html, **lost},
            }
        },
        "/": {"get": {"summary": "A form for a file, and the last result's page", "responses": html}},
        "/health": {
            "get": {
                "summary": "Whether it would answer, and which model would",
                "responses": {"200": _json("Health", "ready"), "503": _json("Health", "the model is being loaded")},
            }
        },
        "/metrics": {"get": {"summary": "Counters, as Prometheus reads them", "responses": _text()}},
        "/openapi.json": {"get": {"summary": "This description", "responses": {"200": {"description": "OpenAPI 3.1"}}}},
        "/docs": {"get": {"summary": "The same, to be read", "responses": html}},
    }
    about = {"title": "spgf_torch serve", "version": __version__, "description": "Grasps from local shape."}
    return {"openapi": "3.1.0", "info": about, "paths": paths, "components": {"schemas": _answers()}}


def _settings(config: ServeConfig, reasons: Mapping[str, str]) -> dict[str, Schema]:
    """What a request may set, by name."""
    kinds, known = get_type_hints(SceneConfig), {entry.name: entry for entry in fields(SceneConfig)}
    own: dict[str, Schema] = {
        "top": {"type": "integer", "minimum": 1, "description": f"grasps of each type; {config.top} without it"},
        "types": {"type": "string", "description": "grasp types that are wanted, as NPG,WPG; all without it"},
    }
    made: dict[str, Schema] = {}
    for name in SETTINGS:
        if name in own:
            made[name] = own[name]
            continue
        schema: Schema = {}
        kind = next(iter(get_args(kinds[name])), kinds[name])
        if kind in (int, float):
            schema["type"] = "integer" if kind is int else "number"
        if (limits := known[name].metadata.get("range")) is not None:
            schema |= {"minimum": limits[0], "maximum": limits[1]}
        if (words := known[name].metadata.get("choice")) is not None:
            schema |= {"type": "string", "enum": list(words)}
        made[name] = {**schema, "description": reasons.get(name, "").replace("\n", " ")}
    made["max_points"]["maximum"] = config.max_points
    return made


def _content(config: ServeConfig, reasons: Mapping[str, str]) -> dict[str, Schema]:
    """The kinds of body."""
    settings = _settings(config, reasons)
    files = {
        key: {"type": "string", "format": "binary", "description": f"a file, as {key}= of the command predict"}
        for key in FILES
    }
    form = {"type": "object", "properties": {**settings, **files}, "required": ["input"]}
    arrays = {"type": "object", "properties": {**settings, **_BODIES}, "additionalProperties": False}
    raw = {"schema": {"type": "string", "format": "binary", "description": "the file as it is"}}
    return {
        "application/json": {"schema": arrays, "example": _EXAMPLE},
        MULTIPART: {"schema": form},
        **{kind: raw for kind in TYPES if kind != "application/json"},
    }


def _answers() -> dict[str, Schema]:
    """The objects that are answered."""
    grasps = {
        "schema": {"const": 1},
        "frame": {"const": "input", "description": "that of what was sent"},
        "base_link": {"type": "string"},
        "judge": {"type": "object", "description": "who ranked and what was known; missing where the votes ranked"},
        "grasps": {"type": "array", "items": {"$ref": "#/components/schemas/Grasp"}},
        "id": {"type": "string"},
        "page": {"type": "string", "description": "address of the page"},
        "model": {"$ref": "#/components/schemas/Model"},
        "seconds": {"type": "object", "additionalProperties": {"type": "number"}, "description": "scene, grasps"},
        "texlets": {"type": "integer", "description": "oriented points that were predicted on"},
        "notes": {"type": "array", "items": {"type": "string"}, "description": "what was assumed or looks wrong"},
        "no_grasp": {"type": ["string", "null"], "description": "why there can be none"},
    }
    return {
        "Grasp": {"type": "object", "properties": {**_GRASP, "judged": _JUDGED}, "required": list(_GRASP)},
        "Grasps": {"type": "object", "properties": grasps, "required": [key for key in grasps if key != "judge"]},
        "Model": _MODEL,
        "Health": {
            "type": "object",
            "properties": {
                "ready": {"type": "boolean"},
                "model": {"$ref": "#/components/schemas/Model"},
                "in_flight": {"type": "integer"},
                "last": {"type": ["string", "null"], "description": "`id` of the last result"},
            },
            "required": ["ready"],
        },
        "Error": {"type": "object", "properties": {"error": {"type": "string"}}, "required": ["error"]},
    }


def _json(name: str, words: str) -> Schema:
    return {"description": words, "content": {"application/json": {"schema": {"$ref": f"#/components/schemas/{name}"}}}}


def _text() -> Schema:
    return {"200": {"description": "counters", "content": {"text/plain": {"schema": {"type": "string"}}}}}
