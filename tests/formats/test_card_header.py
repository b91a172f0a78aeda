"""The YAML header of cards, read as the Hub reads it."""

import pytest
import yaml

from spgf_torch.files.card_header import card_header
from spgf_torch.formats.card import SIZES


def read(text: str) -> dict:
    opened, inner, rest = text.split("---\n")
    assert opened == rest == ""
    return yaml.safe_load(inner)


@pytest.mark.parametrize(
    ("licence", "known"),
    [
        ("MIT", {"license": "mit"}),
        ("CC-BY-4.0", {"license": "cc-by-4.0"}),
        ("Our Lab's, 2nd ed.", {"license": "other", "license_name": "our-lab-s-2nd-ed."}),
        (None, {}),
    ],
)
def test_licences(licence: str | None, known: dict[str, str]) -> None:
    values = read(card_header("panda", licence=licence, task_categories=["robotics"]))
    assert {key: value for key, value in values.items() if key.startswith("license")} == known
    assert values["tags"][-1] == "panda" and values["task_categories"] == ["robotics"]


@pytest.mark.parametrize("hand", ["yes", "5", "a: b", "no # hand"])
def test_names_stay_words(hand: str) -> None:
    assert read(card_header(hand))["tags"][-1] == hand


def test_every_number_has_a_class_of_size() -> None:
    assert [next(name for least, name in SIZES if count >= least) for count in (0, 999, 1000, 99_999, 10**6)] == [
        "n<1K", "n<1K", "1K<n<10K", "10K<n<100K", "1M<n<10M",
    ]  # fmt: skip
