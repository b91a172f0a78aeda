"""The rates of methods in clutter, why their attempts fail, and all their rounds, as tables of HTML with bars."""

from __future__ import annotations

import html
import math
from collections.abc import Mapping, Sequence

from spgf_torch.drawing.clutter_records import MethodRates, Round, Share, Tried
from spgf_torch.drawing.page import caption, table

CAUSES = {
    "pregrasp": "the open hand met something where it waits",
    "approach": "the hand met an object on its way",
    "table": "the hand met the table on its way",
    "missed": "the fingers had an object on too few sides",
    "empty": "the fingers closed on nothing",
    "dropped": "it was lost on lifting",
    "several": "more than one object was lifted",
}


def cards(main: MethodRates) -> str:
    """The main method in large letters."""
    shown = [
        (_percent(main.success) + " %", f"of the attempts succeeded (GSR){_interval(main.success)}"),
        (_percent(main.cleared) + " %", f"of the objects were cleared (DR){_interval(main.cleared)}"),
        (str(main.attempts), f"attempts in {main.scenes} scenes of {main.objects} objects"),
    ]
    if not math.isnan(main.seconds):
        shown.append((f"{main.seconds:.2f} s", "of processor time for a plan, the median"))
    return f'<div class="cards">{"".join(f"<div class=card><b>{b}</b><span>{s}</span></div>" for b, s in shown)}</div>'


def rates(methods: Sequence[MethodRates]) -> str:
    """A row a method."""
    head = ("method", "attempts that succeed, GSR (%)", "objects cleared, DR (%)", "scenes", "attempts", "plan (s)")
    rows = [
        [
            html.escape(each.name),
            share_bar(each.success),
            share_bar(each.cleared),
            str(each.scenes),
            str(each.attempts),
            "" if math.isnan(each.seconds) else f"{each.seconds:.2f}",
        ]
        for each in methods
    ]
    return caption("Bars are rates, lines their 95 % intervals over scenes.") + table(head, rows)


def causes(methods: Sequence[MethodRates]) -> str:
    """A row a cause, a column a method; the most frequent of the main method first."""
    main = methods[0].causes
    found = {cause for each in methods for cause in each.causes}
    if not found:
        return caption("No attempt failed.")
    order = sorted(found, key=lambda cause: (-main.get(cause, 0), cause))
    rows = [[cause_words(cause), *(_cause_bar(each, cause) for each in methods)] for cause in order]
    head = ("why", *(html.escape(each.name) for each in methods))
    return caption("Share of all attempts that fail for this cause, and how many.") + table(head, rows)


def rounds_table(rounds: Sequence[Round], places: Mapping[int, str]) -> str:
    """A row a round. places: of rounds that are drawn, their number here -> the id of their view."""
    head = ("scene", "method", "cleared", "attempts", "ended", "plan (s)")
    rows = []
    for i, each in enumerate(rounds):
        name = html.escape(each.name)
        rows.append(
            [
                f'<a href="#{places[i]}">{name}</a>' if i in places else name,
                html.escape(each.method),
                f"{each.cleared} of {len(each.objects)}",
                "".join(mark(attempt) for attempt in each.attempts),
                html.escape(each.ended),
                "" if math.isnan(each.seconds) else f"{each.seconds:.1f}",
            ]
        )
    words = "Green: an object was taken away, red: it failed, and why. Scenes with a link are drawn above."
    return caption(words) + f'<div class="rounds">{table(head, rows, words=2)}</div>'


def mark(attempt: Tried) -> str:
    """An attempt in one coloured word."""
    word = "held" if attempt.success else html.escape(attempt.cause)
    return f'<span class="{"held" if attempt.success else "failed"}">{word}</span> '


def cause_words(cause: str) -> str:
    """A cause with what it means, where that is known; HTML."""
    known = CAUSES.get(cause)
    return f"<b>{html.escape(cause)}</b>: {known}" if known else f"<b>{html.escape(cause)}</b>"


def share_bar(share: Share) -> str:
    """A rate as a bar with its interval and number; HTML."""
    if math.isnan(share.value):
        return ""
    whisker = ""
    if not math.isnan(share.low + share.high):
        whisker = f'<u style="left:{100 * share.low:.1f}%;width:{100 * (share.high - share.low):.1f}%"></u>'
    bar = f'<i style="width:{100 * share.value:.1f}%"></i>{whisker}'
    return f'<div class="bar">{bar}</div><span class="number">{_percent(share)}{_interval(share)}</span>'


def _cause_bar(method: MethodRates, cause: str) -> str:
    count = method.causes.get(cause, 0)
    part = count / method.attempts if method.attempts else 0.0
    bar = f'<div class="bar failures"><i style="width:{100 * part:.1f}%"></i></div>'
    return f'{bar}<span class="number">{100 * part:.0f} % ({count})</span>'


def _percent(share: Share) -> str:
    return "-" if math.isnan(share.value) else f"{100 * share.value:.0f}"


def _interval(share: Share) -> str:
    known = not math.isnan(share.low + share.high)
    return f" ({100 * share.low:.0f}-{100 * share.high:.0f})" if known else ""
