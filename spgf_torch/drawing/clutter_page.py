"""Clutter as one HTML file that needs nothing else: rates, causes, all rounds, and the worst scenes to turn."""

from __future__ import annotations

import base64
import html
from collections.abc import Sequence
from importlib.resources import files
from pathlib import Path

from spgf_torch.drawing.clutter_rates import cards, causes, rates, rounds_table
from spgf_torch.drawing.clutter_records import Round, Summary
from spgf_torch.drawing.clutter_view import round_view
from spgf_torch.drawing.page import Section, caption, page, turning
from spgf_torch.files.writing import write_text
from spgf_torch.hands.hand import Hand

WORST = 5  # rounds that are drawn: a browser gives a page about sixteen WebGL contexts


def write_clutter_page(
    path: Path,
    summary: Summary,
    rounds: Sequence[Round],
    hand: Hand,
    worst: int = WORST,
    film: Path | None = None,
) -> list[Round]:
    """Write the page, and return the rounds that are drawn in it: the worst of the main method.

    Args:
        rounds: of all methods, as they are to be listed. worst: so many are drawn at most.
        film: a GIF of a round, which becomes part of the page.
    """
    drawn = worst_rounds(rounds, summary.methods[0].name, worst)
    places = {index: f"scene{k}" for k, index in enumerate(drawn, start=1)}
    views = "".join(_round_html(rounds[index], hand, places[index]) for index in drawn)
    styles = files("spgf_torch.drawing").joinpath("clutter_page.css").read_text(encoding="utf-8")
    lead = f"<style>\n{styles}</style>" + "".join(f"<p>{html.escape(line)}</p>" for line in summary.lines)
    notes = "".join(f"<li>{html.escape(line)}</li>" for line in summary.notes)
    sections = [
        Section("rates", "Rates", cards(summary.methods[0]) + rates(summary.methods)),
        Section("causes", "Why attempts fail", causes(summary.methods)),
        *([Section("worst", "The worst scenes", caption(_SEEN) + views)] if drawn else []),
        *([Section("film", "A round, filmed", _film_html(film))] if film else []),
        Section("rounds", "All rounds", rounds_table(rounds, places)),
        *([Section("notes", "How to read this", f"<ul>{notes}</ul>")] if summary.notes else []),
    ]
    write_text(path, page(summary.title, lead, sections))
    return [rounds[index] for index in drawn]


def _film_html(film: Path) -> str:
    data = base64.b64encode(film.read_bytes()).decode()
    return f'<figure class="film"><img alt="a film of a round" src="data:image/gif;base64,{data}"></figure>'


def worst_rounds(rounds: Sequence[Round], method: str, count: int) -> list[int]:
    """Numbers of a method's rounds that left most, and of those the ones that failed most; none without a view."""
    found = [i for i, each in enumerate(rounds) if each.method == method and (each.attempts or each.last)]
    left = [len(rounds[i].objects) - rounds[i].cleared for i in found]
    order = sorted(range(len(found)), key=lambda k: (-left[k], -rounds[found[k]].failed, k))
    return [found[k] for k in order[:count]]


def _round_html(each: Round, hand: Hand, place: str) -> str:
    many = "attempt" if len(each.attempts) == 1 else "attempts"
    head = f"{each.name}: {each.cleared} of {len(each.objects)} cleared in {len(each.attempts)} {many}; {each.ended}"
    return f'<h3 id="{place}">{html.escape(head)}</h3>' + turning(round_view(each, hand))


_SEEN = (
    "Things in pale colours with the sensed cloud in dots; the open hand where an attempt put it, green where it held, "
    "red where it failed. Grey pyramids are the directions of the cameras, which stand farther off. All of it is as it "
    "was before the attempt."
)
