"""A judge of hypotheses: the probability that an executed grasp holds, as P(free) x P(holds | free).

Each factor is boosted trees, or a logistic regression, on the numbers of `judge_features`. A judge has a second pair of
factors for clouds without images, in which unseen space is not known. What is ranked best was often only judged too
well: a map learned from executed grasps, which judges had chosen that had not seen the object, sets the probabilities
right by number of views and leaves the order as it is. A judge may have learned in scenes, too: a third pair of factors
weighs what the first said together with all numbers, and needs no map: it learned from executed grasps, the best ones
among them. `judge.safetensors` holds the arrays and `judge.json` the hand, the settings and how it did on objects that
it had not seen; neither can run code when read, and each carries its digest.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

import torch
from safetensors import SafetensorError
from safetensors.torch import load, save
from torch import Tensor

from spgf_torch.errors import InputError
from spgf_torch.files.digests import BLANK, KEY, check_seal, digest_of, sealed, sealed_json
from spgf_torch.files.reading import existing, json_values, unreadable
from spgf_torch.files.writing import write_bytes
from spgf_torch.hands.config import HandConfig, grasp_types
from spgf_torch.proposing.config import HypothesesConfig
from spgf_torch.proposing.judge_features import GEOMETRY, NAMES
from spgf_torch.proposing.tree_ensembles import FORMS, Form
from spgf_torch.settings import typed

FORMAT = "spgf_torch judge"
SCHEMA = 3
DIGEST = "tensors_sha256"  # key in judge.json: SHA-256 of judge.safetensors
LARGEST = 16_000_000  # bytes of judge.safetensors; a judge of today's settings has a third of a million
ARRAYS, ABOUT = "judge.safetensors", "judge.json"
# What a judge knows: with images all numbers, without them those of geometry alone.
KNOWN: Mapping[str, tuple[str, ...]] = {"images": NAMES, "bare": GEOMETRY}
FACTORS = ("free", "holds")
# What a judge that learned in scenes knows there: also what it would say without.
SCENE = "scene"
SCENE_NUMBERS = (*NAMES, *(f"log_{factor}" for factor in FACTORS))
# Names of the maps to probabilities of executed grasps: of one view, and of several.
VIEWS = ("one", "more")
# Of a map: slope > 0 against log p, slope > 0 against -log(1 - p), and shift of the log-odds (beta calibration, Kull,
# Silva Filho and Flach 2017).
Curve = tuple[float, float, float]
# Probabilities nearer 0 or 1 than this are not distinguished by a map.
_EDGE = 1e-9
_SETTINGS: dict[str, type] = {"hand": HandConfig, "hypotheses": HypothesesConfig}


@dataclass(frozen=True)
class Judge:
    """What was learned for one hand.

    Attributes:
        factors: (what is known, factor) -> its form: keys of `KNOWN`, maybe `SCENE`, and `FACTORS`.
        settings: hand and hypotheses, as plain values; they belong to what was learned.
        sure: probability below which a grasp is not to be relied on.
        taught: object name -> digest, of what it learned from. results: how it did on held-out objects.
        calibration: of `VIEWS` the curve from what the factors say to how often executed grasps held; a missing one
            leaves them as they are.
        about: what its file says beside: digest of the arrays, `date` of learning.
    """

    factors: Mapping[tuple[str, str], Form]
    settings: Mapping[str, Any]
    sure: float
    taught: Mapping[str, str] = field(default_factory=dict)
    results: Mapping[str, Any] = field(default_factory=dict)
    calibration: Mapping[str, Curve] = field(default_factory=dict)
    about: Mapping[str, Any] = field(default_factory=dict, compare=False)

    def probability(self, numbers: Tensor, images: bool) -> Tensor:
        """(G,) f32 that grasps hold, from their numbers (G, 31); `images`: whether unseen space is known."""
        free, holds = self.both(numbers, images)
        return (free * holds).float()

    def both(self, numbers: Tensor, images: bool) -> tuple[Tensor, Tensor]:
        """(G,) f64 each: P(free), P(holds | free); the calibration is shared out between them, in their proportion."""
        known = "images" if images else "bare"
        given = numbers[:, : len(KNOWN[known])]
        free, holds = (self.factors[known, factor].log_odds(given).sigmoid() for factor in FACTORS)
        if not images:
            return free, holds
        raw = (free * holds).clamp(_EDGE, 1 - _EDGE)
        power = calibrated(raw, numbers[:, NAMES.index("views")], self.calibration).log() / raw.log()
        return free**power, holds**power

    def both_in_scene(self, numbers: Tensor) -> tuple[Tensor, Tensor]:
        """The same among other things on a table: P(nothing is met on the way), P(holds | so).

        The mean of what single objects and what scenes taught, in log-odds: there are fewer scenes to learn from.
        """
        given = self.scene_numbers(numbers)
        said = given[:, len(NAMES) :].double().unbind(1)
        taught = (self.factors[SCENE, factor].log_odds(given) for factor in FACTORS)
        free, holds = ((old + new).div(2).sigmoid() for old, new in zip(said, taught, strict=True))
        return free, holds

    def scene_numbers(self, numbers: Tensor) -> Tensor:
        """(G, 33) f32: `SCENE_NUMBERS`, the last of them what the factors with images say, uncalibrated."""
        said = [self.factors["images", factor].log_odds(numbers) for factor in FACTORS]
        return torch.cat([numbers, torch.stack(said, dim=1).float()], dim=1)

    @property
    def knows_scenes(self) -> bool:
        """Whether it learned in scenes."""
        return (SCENE, FACTORS[0]) in self.factors

    @property
    def grasp_types(self) -> tuple[str, ...]:
        """Names of the grasp types, by the codes that it learned."""
        return grasp_types(typed(HandConfig, self.settings["hand"]))

    @property
    def hypotheses(self) -> HypothesesConfig:
        """The settings that its numbers were made with."""
        return typed(HypothesesConfig, self.settings["hypotheses"])

    def check_hand(self, hand: Any, whose: str) -> None:
        """Raise InputError unless `hand` (plain settings) is the judge's."""
        if self.settings["hand"] != hand:
            got, name = (values.get("name") for values in (self.settings["hand"], hand or {}))
            other = " of other settings" if got == name else ""
            raise InputError(
                f"judge: expected one of {whose} ({name}), got one of {got}{other}; learn one: "
                f"python -m spgf_torch.judge hand={name}"
            )


def calibrated(p: Tensor, views: Tensor, calibration: Mapping[str, Curve]) -> Tensor:
    """(G,) f64: how often grasps hold of which p (G,) was said, in clouds of `views` (G,) images; see `Judge`."""
    said = p.double().clone()
    for name, of in zip(VIEWS, (views <= 1, views > 1), strict=True):
        if name in calibration:
            low, high, shift = calibration[name]
            its = said[of].clamp(_EDGE, 1 - _EDGE)
            said[of] = (low * its.log() - high * (-its).log1p() + shift).sigmoid().clamp(_EDGE, 1 - _EDGE)
    return said


def save_judge(judge: Judge, folder: Path) -> int:
    """Write `judge.safetensors`, then `judge.json`; returns the bytes of the former."""
    tensors, forms = {}, {}
    for (known, factor), form in judge.factors.items():
        forms[f"{known}.{factor}"] = next(name for name, kind in FORMS.items() if isinstance(form, kind))
        for part in fields(form):
            tensors[f"{known}.{factor}.{part.name}"] = getattr(form, part.name).contiguous()
    content = sealed(save(tensors, {KEY: BLANK.decode()}))
    write_bytes(folder / ARRAYS, content)
    document = {
        "format": FORMAT,
        "schema": SCHEMA,
        "numbers": list(NAMES),
        **({"scene_numbers": list(SCENE_NUMBERS)} if judge.knows_scenes else {}),
        "grasp_types": list(judge.grasp_types),
        "forms": forms,
        "sure": judge.sure,
        "settings": dict(judge.settings),
        "taught": dict(judge.taught),
        "results": dict(judge.results),
        "calibration": {name: list(curve) for name, curve in judge.calibration.items()},
        DIGEST: hashlib.sha256(content).hexdigest(),
        **({"date": judge.about["date"]} if "date" in judge.about else {}),
    }
    write_bytes(folder / ABOUT, sealed_json(document, indent=1, sort_keys=True))
    return len(content)


def load_judge(folder: Path) -> Judge:
    """The judge in a folder. Raises InputError in one line if it is missing, damaged, edited or not ours."""
    document = _document(folder / ABOUT)
    path = folder / ARRAYS
    tensors = _tensors(path, document[DIGEST])
    factors = {}
    learned = {**KNOWN, SCENE: SCENE_NUMBERS} if "scene_numbers" in document else KNOWN
    for known, numbers in learned.items():
        for factor in FACTORS:
            name = f"{known}.{factor}"
            kind = FORMS[document["forms"][name]]
            try:
                form: Form = kind(**{part.name: tensors[f"{name}.{part.name}"] for part in fields(kind)})
                form.check(len(numbers))
            except (KeyError, InputError, RuntimeError, IndexError) as error:
                raise InputError(
                    f"{path}: {name}: expected the arrays of a judge, got ones that do not fit ({error})"
                ) from None
            factors[known, factor] = form
    settings, sure, taught, results = (document[key] for key in ("settings", "sure", "taught", "results"))
    curves = {name: (curve[0], curve[1], curve[2]) for name, curve in document["calibration"].items()}
    about = {key: document[key] for key in (DIGEST, "date") if key in document}
    return Judge(factors, settings, sure, taught, results, curves, about)


def _tensors(path: Path, digest: str) -> dict[str, Tensor]:
    if (size := existing(path).stat().st_size) > LARGEST:
        raise InputError(f"{path}: expected the arrays of a judge of at most {LARGEST} bytes, got {size}")
    check_seal(path, "the arrays of a judge")
    if digest != digest_of(path):
        raise InputError(
            f"{path}: expected the arrays that {ABOUT} beside it was written with, got arrays of another digest"
        )
    try:
        return load(path.read_bytes())
    except (SafetensorError, OSError, ValueError, KeyError) as error:
        raise unreadable(path, "a safetensors file", error) from None


def _document(path: Path) -> dict[str, Any]:
    if not path.is_file():
        raise InputError(
            f"{path}: expected a judge that python -m spgf_torch.judge left (judge=FOLDER), found no such file"
        )
    document = json_values(path, "a judge's JSON", sealed=True)
    found = (document.get("format"), document.get("schema")) if isinstance(document, dict) else type(document).__name__
    if found != (FORMAT, SCHEMA):
        raise InputError(
            f"{path}: expected format {FORMAT!r}, schema {SCHEMA}; got {found}; learn it again: "
            "python -m spgf_torch.judge hand=NAME"
        )
    forms, wanted = document.get("forms"), {f"{known}.{factor}" for known in KNOWN for factor in FACTORS}
    if "scene_numbers" in document:
        wanted |= {f"{SCENE}.{factor}" for factor in FACTORS}
    numbers = document.get("numbers"), document.get("scene_numbers", list(SCENE_NUMBERS))
    if numbers != (list(NAMES), list(SCENE_NUMBERS)):
        raise InputError(f"{path}: expected a judge of this version's {len(NAMES)} numbers, got one of others")
    if not isinstance(forms, dict) or set(forms) != wanted or not set(forms.values()) <= set(FORMS):
        raise InputError(f"{path}: expected forms of {', '.join(sorted(wanted))}; got {forms}")
    for key, kind in (("sure", float), ("settings", dict), ("taught", dict), ("results", dict), (DIGEST, str)):
        if not isinstance(document.get(key), kind):
            raise InputError(f"{path}: expected {key}, got {document.get(key)!r}")
    if not isinstance(document.get("date", ""), str):
        raise InputError(f"{path}: expected a date in words, got {document['date']!r:.40}")
    curves = document.get("calibration")
    if not isinstance(curves, dict) or not all(name in VIEWS and _rising(curve) for name, curve in curves.items()):
        raise InputError(
            f"{path}: expected calibration of {', '.join(VIEWS)}: two slopes > 0 and a shift; got {curves}"
        )
    for key, room in _SETTINGS.items():
        try:
            typed(room, document["settings"].get(key, {}))
        except InputError as error:
            raise InputError(f"{path}: settings.{key}: {error}") from None
    types = list(grasp_types(typed(HandConfig, document["settings"].get("hand", {}))))
    if document.get("grasp_types") != types:
        raise InputError(f"{path}: expected grasp_types {types}, those of its hand; got {document.get('grasp_types')}")
    return document


def _rising(curve: Any) -> bool:
    """Whether this is a `Curve`, whose slopes are above 0."""
    numbers = isinstance(curve, list) and len(curve) == 3 and all(type(value) in (int, float) for value in curve)
    return numbers and min(curve[:2]) > 0 and all(math.isfinite(value) for value in curve)
