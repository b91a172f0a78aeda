"""The grasp page in a real browser: clicks, filters, slider, keys, and nothing wrong on the console."""

from collections.abc import Iterator
from itertools import product
from pathlib import Path

import pytest
from asymmetric import GRIPPERS
from browser import needs_browser
from driven_browser import SOFTWARE_GL, DrivenBrowser, Tab
from shown_grasps import ball, write_shown

from spgf_torch.drawing.grasp_page import write_scene_page

pytestmark = needs_browser
SIZE = (900, 560)
COLOURS = """(() => {
  const small = document.createElement("canvas"), pen = small.getContext("2d");
  small.width = small.height = 64;
  pen.drawImage(document.querySelector("canvas"), 0, 0, 64, 64);
  const bytes = pen.getImageData(0, 0, 64, 64).data;
  return new Set(Array.from({ length: 4096 }, (_, i) => bytes.slice(4 * i, 4 * i + 3).join())).size;
})()"""
NAMELESS = """[...document.querySelectorAll("button, select, input, canvas, img")].filter((e) =>
  !(e.labels?.length || e.ariaLabel || (e.tagName === "IMG" && e.hasAttribute("alt")) || e.textContent.trim()))
  .map((e) => e.outerHTML)"""
DRAWN = "new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))"


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("viewer")
    write_shown(folder)
    return folder / "index.html"


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[DrivenBrowser]:
    started = DrivenBrowser(tmp_path_factory.mktemp("profile"), *SOFTWARE_GL)
    yield started
    started.close()


@pytest.fixture(scope="module")
def tab(browser: DrivenBrowser, page: Path) -> Tab:
    """One page for all tests, which leave it as they found it: the first grasp chosen, everything shown."""
    return browser.open(page, SIZE)


@pytest.fixture(autouse=True)
def nothing_wrong(request: pytest.FixtureRequest) -> Iterator[None]:
    yield
    if "tab" in request.fixturenames:
        tab = request.getfixturevalue("tab")
        tab.run("document.querySelector('#filters').reset()")
        tab.until("document.body.dataset.shown === '4'")
        tab.click("#grasps tbody tr:nth-child(1) button")
        assert tab.wrong() == []


def chosen(tab: Tab) -> int:
    return int(tab.run("document.body.dataset.chosen"))


def colours(tab: Tab) -> int:
    """How many colours the canvas shows: a view that is not drawn has one."""
    tab.run(DRAWN)
    return int(tab.run(COLOURS))


def slide(tab: Tab, selector: str, value: int) -> None:
    """Set a slider as a hand would: with an event of input."""
    tab.run(
        f"(() => {{ const s = document.querySelector('{selector}'); s.value = {value};"
        " s.dispatchEvent(new Event('input', {bubbles: true})); })()"
    )


def test_it_opens_with_the_best_grasp_drawn(tab: Tab) -> None:
    assert chosen(tab) == 1 and colours(tab) > 30
    assert tab.run("document.querySelector('#count').textContent") == "4 of 4 shown"
    assert tab.run("document.querySelector('#moved').textContent") == "at the grasp, open"
    assert tab.run("document.querySelector('#colours').value") == "sensed"
    assert tab.run("document.querySelectorAll('.gizmo line').length") == 3
    assert tab.run("document.querySelector('.scale').textContent").endswith(" mm")
    assert tab.run("document.body.classList.contains('flat')") is False


def test_names_of_files_and_prototypes_are_no_markup(tab: Tab) -> None:
    assert tab.run("document.querySelectorAll('b').length && [...document.images].every((i) => !i.src.endsWith('/x'))")
    names = tab.run("[...document.querySelectorAll('.prototype span')].map((e) => e.textContent)")
    assert names == ["</script><b>evil 3", "</script><b>evil 7"]
    assert tab.run("document.querySelector('h1').textContent") == "Grasps for <img src=x onerror=alert(1)>.pcd"


def test_a_row_chooses_and_is_told(tab: Tab) -> None:
    """The third: target 2, 30 %, free with 60 %, then holds with 50 %; no votes."""
    tab.click("#grasps tbody tr:nth-child(3)")
    assert chosen(tab) == 3
    assert tab.run("document.querySelector('tr.chosen button').textContent") == "3"
    told = tab.run("document.querySelector('#why').innerText")
    assert told.startswith("Grasp 3: WPG, target 2, 30 %") and "60 %" in told and "50 %" in told
    assert "nearest point to the hand" in told and "+2.17" in told and "\u22121.00" in told


def test_a_click_on_a_hand_chooses_its_row(tab: Tab) -> None:
    """The second stands apart from the others: somewhere in the view its outline is under the mouse."""
    tab.click('[data-part="others"]')
    tab.click('[data-eye="above"]')
    tab.run(DRAWN)
    x, y, width, height = tab.run(
        "(({x, y, width, height}) => [x, y, width, height])(document.querySelector('canvas').getBoundingClientRect())"
    )
    for row, column in product(range(0, 40, 2), repeat=2):
        place = x + width * (column + 0.5) / 40, y + height * (row + 0.5) / 40
        tab.mouse("mouseMoved", *place)
        if tab.run("document.querySelector('canvas').dataset.at") == "2":
            assert tab.run("document.querySelector('.tip').textContent") == "grasp 2: NPG, 60 %"
            tab.mouse("mousePressed", *place)
            tab.mouse("mouseReleased", *place)
            assert chosen(tab) == 2 and tab.run("document.querySelector('tr.chosen button').textContent") == "2"
            return
    pytest.fail("the outline of the second grasp is nowhere")


def test_keys_step_through_what_is_shown(tab: Tab) -> None:
    for key, expected in (("j", 2), ("ArrowDown", 3), ("k", 2), ("ArrowUp", 1), ("ArrowUp", 4)):
        tab.press(key)
        assert chosen(tab) == expected, key
    tab.press("?")
    assert tab.run("document.querySelector('dialog').open")
    tab.press("j")  # not while the help is open
    assert chosen(tab) == 4
    tab.click("dialog button")
    assert not tab.run("document.querySelector('dialog').open")


def test_filters_hide_rows_and_choose_among_the_rest(tab: Tab) -> None:
    tab.click('input[value="WPG"]')
    assert tab.run("document.querySelector('#count').textContent") == "2 of 4 shown"
    assert chosen(tab) == 2  # the first was a WPG
    slide(tab, "#most", 50)
    assert tab.run("[...document.querySelectorAll('#grasps tbody tr')].map((r) => r.hidden)") == [
        True,
        True,
        True,
        False,
    ]
    assert chosen(tab) == 4
    slide(tab, "#least", 70)  # raises the other end, too; nothing is left: told, not drawn
    assert chosen(tab) == 0 and "No grasp passes" in tab.run("document.querySelector('#why').textContent")
    tab.press("j")
    tab.click("#filters button[type=reset]")
    tab.until("document.body.dataset.shown === '4'")
    slide(tab, "select[name=target]", 2)
    assert chosen(tab) == 3


def test_the_slider_comes_and_closes(tab: Tab) -> None:
    """60 mm back at its beginning; fingers 80 mm apart meet a ball of 80 mm at once, so that it is touched early."""
    slide(tab, "#motion", 0)
    assert tab.run("document.querySelector('#moved').textContent") == "60 mm before the grasp"
    slide(tab, "#motion", 1000)
    assert tab.run("document.querySelector('#moved').textContent") == "closed by 100 %, past the first touch"
    assert tab.run("document.querySelector('#motion').getAttribute('aria-valuetext')").startswith("closed by 100 %")
    tab.click("#play")
    tab.until("document.querySelector('#play').textContent === 'Play'")
    assert 400 <= int(tab.run("document.querySelector('#motion').value")) < 600
    assert (
        "a finger touches" in tab.run("document.querySelector('#moved').textContent")
        or int(tab.run("document.querySelector('#motion').value")) == 400
    )


def test_a_prototype_shows_its_votes_alone(tab: Tab) -> None:
    """Three votes: 1.5 and 0.25 of prototype 3, -0.5 of 7."""
    cells = "(row) => [...row.cells].slice(1).map((cell) => cell.innerText.trim())"
    rows = tab.run(f"[...document.querySelectorAll('.voted tbody tr')].map({cells})")
    assert rows == [["2", "+1.75"], ["1", "\u22120.50"]]
    assert tab.run("document.querySelectorAll('.voted img').length") == 1
    tab.click('.prototype[data-prototype="7"]')
    assert tab.run("document.body.dataset.only") == "7"
    assert tab.run("document.querySelector('.prototype[data-prototype=\"7\"]').getAttribute('aria-pressed')") == "true"
    tab.click('.prototype[data-prototype="7"]')
    tab.mouse("mouseMoved", 2, 2)
    assert tab.run("document.body.dataset.only") == ""


def test_controls_have_names(tab: Tab) -> None:
    assert tab.run(NAMELESS) == []


def test_light_and_dark(tab: Tab) -> None:
    paper = "getComputedStyle(document.body).backgroundColor"
    light = tab.run(paper)
    tab.click("#theme")  # from auto, which is light here, to light
    assert tab.run(paper) == light
    tab.click("#theme")
    dark = tab.run(paper)
    assert dark != light
    tab.click("#theme")
    tab.call("Emulation.setEmulatedMedia", features=[{"name": "prefers-color-scheme", "value": "dark"}])
    assert tab.run(paper) == dark
    tab.call("Emulation.setEmulatedMedia", features=[{"name": "prefers-color-scheme", "value": "light"}])


def test_on_a_phone_view_and_table_stand_below_each_other(browser: DrivenBrowser, page: Path) -> None:
    phone = browser.open(page, (390, 844), touch=True)
    view, rows = phone.run("['#view', '#list'].map((s) => document.querySelector(s).getBoundingClientRect().toJSON())")
    assert view["bottom"] <= rows["top"] and phone.run("document.documentElement.scrollWidth") <= 390
    phone.run("document.querySelector('#grasps tbody tr:nth-child(4)').scrollIntoView({block: 'end'})")
    assert phone.run("document.querySelector('#view').getBoundingClientRect().top") >= -1  # still in sight
    assert phone.wrong() == []
    phone.close()


def test_a_page_without_grasps_can_be_turned(browser: DrivenBrowser, tmp_path: Path) -> None:
    write_scene_page(tmp_path / "a.html", tmp_path / "a.png", *ball(), [], GRIPPERS)
    empty = browser.open(tmp_path / "a.html", SIZE)
    assert colours(empty) > 5 and empty.run("document.querySelector('#play').disabled")
    assert "There is no grasp" in empty.run("document.querySelector('#why').textContent")
    empty.press("j")
    assert empty.wrong() == []
    empty.close()


def test_without_webgl_the_picture_and_the_table_are_there(browser: DrivenBrowser, page: Path) -> None:
    """As where a browser has none: its canvas gives no context."""
    flat = browser.open(page, SIZE, before="HTMLCanvasElement.prototype.getContext = () => null;")
    assert flat.run("document.body.classList.contains('flat')")
    assert flat.run("document.querySelector('.still').getBoundingClientRect().width") > 100
    assert flat.run("getComputedStyle(document.querySelector('canvas')).display") == "none"
    flat.click("#grasps tbody tr:nth-child(2) button")
    assert chosen(flat) == 2 and "Grasp 2: NPG" in flat.run("document.querySelector('#why').innerText")
    assert flat.wrong() == []
    flat.close()
