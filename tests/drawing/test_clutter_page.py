"""The page of clutter: what stands in it, worked out by hand, and how it behaves in a real browser."""

import json
import re
from dataclasses import replace
from pathlib import Path

import pytest
from browser import needs_browser, opened
from clutter_rounds import OBJECTS, hand, rates, round_, summary, view

from spgf_torch.drawing.clutter_page import worst_rounds, write_clutter_page
from spgf_torch.drawing.clutter_rates import causes, mark, share_bar
from spgf_torch.drawing.clutter_records import Round, Share
from spgf_torch.drawing.style import FAILED, HELD


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    page = tmp_path_factory.mktemp("clutter") / "clutter.html"
    rounds = [round_("random"), round_(name="pile </script> 7"), Round("ours", "pile 8", OBJECTS, (), "no grasp")]
    drawn = write_clutter_page(page, summary(), rounds, hand())
    assert drawn == [rounds[1]]
    return page


def content(page: Path) -> dict:
    return json.loads(re.search(r'<script type="application/json">(.*?)</script>', page.read_text(), re.DOTALL)[1])


def test_the_page_needs_nothing_else(written: Path) -> None:
    text = written.read_text()
    assert text.count("plotly.js v") == 1 and text.count('class="view"') == 1
    own = re.sub(r"<script>.*?</script>", "", text, flags=re.DOTALL)  # plotly.js itself has addresses, unused
    assert not re.search(r"""(src|href)=["']?(https?:)?//|url\(["']?(https?:)?//|@import""", own)
    assert len(own) < 300_000  # five of them stay below 1.5 MB
    assert "Piles &lt;3" in own and "a &amp; b" in own and "c &lt; d" in own
    assert [path.name for path in written.parent.iterdir()] == ["clutter.html"]


def test_where_things_stand(written: Path) -> None:
    """The box stands at (100, 20, 0) mm, a quarter turn about z; the hand of the first attempt comes from above at
    (100, 20, 50), red, that of the second is green. The can is gone at the end."""
    found = content(written)
    assert [item["name"] for item in found["items"]] == ["all 2", "1: failed, dropped", "2: held", "the end"]
    whole = {trace.get("text"): trace for trace in found["items"][1]["traces"] if trace["type"] == "mesh3d"}
    assert whole["box"]["pose"] == [0, -1, 0, 100, 1, 0, 0, 20, 0, 0, 1, 0]
    corners = found["shapes"][whole["box"]["shape"]]["points"]
    assert [min(axis) for axis in zip(*corners, strict=True)] == [-25, -40, 0]
    one, two = (found["items"][index]["traces"][-1] for index in (1, 2))
    assert one["pose"] == [1, 0, 0, 100, 0, -1, 0, 20, 0, 0, -1, 50]
    assert (one["color"], two["color"]) == (FAILED, HELD) and one["shape"] != two["shape"]
    names = [trace.get("text") for trace in found["items"][3]["traces"]]
    assert "can" not in names and "box" in names and "cup" in names
    told = [item["told"] for item in found["items"]]
    assert (
        told[1] == "Attempt 1 of 2: NPG, foretold 62 %. Failed, dropped: it was lost on lifting. Met on the way: cup."
    )
    assert told[2] == "Attempt 2 of 2: WPG. Held can."
    assert told[3] == "What was left and seen at the end: no grasp."


def test_cloud_and_camera(written: Path) -> None:
    """The cloud is a plane at 50 mm; the camera at (0, -0.48, 0.36) is drawn 280 mm from the middle: (0, -224, 168)."""
    found = content(written)
    traces = found["items"][1]["traces"]
    cloud = next(trace for trace in traces if trace.get("mode") == "markers")
    points = found["shapes"][cloud["shape"]]["points"]
    assert len(points) == 300 and {point[2] for point in points} == {50}
    camera = next(trace for trace in traces if trace.get("text") == "a camera")
    assert [camera[axis][0] for axis in "xyz"] == [0, -224, 168]


def test_rows_and_cards(written: Path) -> None:
    own = re.sub(r"<script.*?</script>", "", written.read_text(), flags=re.DOTALL)
    assert "75 %" in own and "(60-90)" in own and 'style="left:60.0%;width:30.0%"' in own
    assert own.count('<span class="failed">dropped</span> <span class="held">held</span>') == 2
    assert own.count("1 of 3") == 3 and "0 of 3" in own  # two rows and the head of the view; no attempt
    assert '<a href="#scene1">pile &lt;/script&gt; 7</a>' in own and "pile </script>" not in own


def test_causes_are_sorted_by_the_main_method() -> None:
    """4 of 20 attempts dropped, 1 for a cause without an explanation, of the other method 5 empty."""
    text = causes(summary().methods)
    places = [text.index(f"<b>{cause}</b>") for cause in ("dropped", "strange", "empty")]
    assert places == sorted(places)
    assert "20 % (4)" in text and "5 % (1)" in text and "25 % (5)" in text
    assert causes([rates()]) == '<p class="caption">No attempt failed.</p>'


def test_unknown_rates_and_intervals() -> None:
    nothing = float("nan")
    assert share_bar(Share(nothing, nothing, nothing)) == ""
    assert "<u" not in share_bar(Share(0.5, nothing, nothing)) and "50<" in share_bar(Share(0.5, nothing, nothing))


def test_the_worst_come_first() -> None:
    """By what is left, then by failures; other methods, and rounds without a view, are left out."""
    base = round_()
    dropped, held = base.attempts
    rounds = [
        replace(base, attempts=(held,)),  # 2 left
        replace(base, attempts=(dropped, held)),  # 2 left, one failure
        replace(base, method="random", attempts=(dropped,)),
        replace(base, attempts=(), last=None),
        replace(base, attempts=(dropped,)),  # 3 left
    ]
    assert worst_rounds(rounds, "ours", 9) == [4, 1, 0]
    assert worst_rounds(rounds, "ours", 2) == [4, 1]


def test_a_round_without_attempts_shows_what_was_seen(tmp_path: Path) -> None:
    write_clutter_page(
        tmp_path / "a.html", summary(), [Round("ours", "pile 9", OBJECTS, (), "no grasp", view((0,)))], hand()
    )
    assert [item["name"] for item in content(tmp_path / "a.html")["items"]] == ["the end"]


def test_a_film_becomes_part_of_the_page(tmp_path: Path) -> None:
    (tmp_path / "a.gif").write_bytes(b"GIF89a?")
    write_clutter_page(tmp_path / "a.html", summary(), [], hand(), film=tmp_path / "a.gif")
    text = (tmp_path / "a.html").read_text()
    assert 'src="data:image/gif;base64,R0lGODlhPw=="' in text and 'id="worst"' not in text


def test_a_cause_is_escaped() -> None:
    assert mark(replace(round_().attempts[0], cause="<b>")) == '<span class="failed">&lt;b&gt;</span> '


KEYS = """<script>addEventListener("load", () => {
  for (const view of waiting.splice(0)) start(view);
  const view = document.querySelector(".view"), plot = view.querySelector(".plot");
  const press = (key) => view.dispatchEvent(new KeyboardEvent("keydown", { key }));
  const list = view.querySelector("select"), first = list.selectedIndex;
  const box = plot.data.find((trace) => trace.text === "box");
  press("n");
  const far = plot.layout.scene.camera.eye.x;
  press("+");
  press("ArrowLeft");
  console.log("keys", first, list.selectedIndex, plot.data.at(-1).color, view.querySelector(".told").textContent,
    Math.max(...box.x), Math.min(...box.y), getComputedStyle(view.querySelector(".still")).display,
    getComputedStyle(document.body).backgroundColor, document.documentElement.scrollWidth <= innerWidth);
});</script></body>"""


@needs_browser
def test_a_browser_steps_with_keys_in_the_dark(written: Path, tmp_path: Path) -> None:
    """From the first failure to the attempt that held, on a narrow screen. Turned by 90 deg the box of 50 x 80 mm ends
    at x = 100 + 40, and begins at y = 20 - 25."""
    page = tmp_path / "page.html"
    page.write_text(written.read_text().replace("</body>", KEYS))
    dark = ("--blink-settings=preferredColorScheme=0",)
    console = opened(page, tmp_path / "page.png", *dark, size=(500, 900))
    assert not [line for line in console if re.search("Error|Uncaught|ERR_|WebGL is not supported", line)], console
    words = f'keys 1 2 {HELD} Attempt 2 of 2: WPG. Held can. 140 -5 none rgb(18, 22, 27) true"'
    assert any(words in line for line in console), console


@needs_browser
def test_a_browser_without_webgl_shows_the_picture(written: Path, tmp_path: Path) -> None:
    page = tmp_path / "page.html"
    then = """<script>addEventListener("load", () => { for (const view of waiting.splice(0)) start(view);
      const shown = (name) => document.querySelector(name).getBoundingClientRect().height > 100;
      console.log("still", shown(".still img"), shown(".plot"), document.querySelector(".told").textContent);
    });</script></body>"""
    page.write_text(written.read_text().replace("</body>", then))
    console = opened(page, tmp_path / "page.png", "--disable-3d-apis")
    assert not [line for line in console if re.search("Error|Uncaught|ERR_", line)], console
    assert any('"still true false Attempt 1 of 2' in line for line in console), console
