"""README and docs/: Python blocks run, commands have settings that exist, links lead to files, no key lacks a page.

A block that takes too long, or needs what a test has not, says so where it begins: ```python skip="reason".
The blocks of docs/tutorials are run in tests/docs, those of each page in order.
"""

import pkgutil
import re
import shlex
import sys
from collections.abc import Iterator
from copy import deepcopy
from dataclasses import fields, is_dataclass
from functools import cache, reduce
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from hydra import compose, initialize_config_dir
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.override_parser.types import Glob
from omegaconf import OmegaConf
from PIL import Image

import spgf_torch
from spgf_torch.__main__ import COMMANDS
from spgf_torch.cli.command_line import known_settings, translated
from spgf_torch.cli.options import as_overrides
from spgf_torch.errors import InputError
from spgf_torch.hands.config import ClosingConfig, HandConfig, JointConfig, PreshapeConfig
from spgf_torch.sensing.cameras import Camera, cast, intrinsics, look_at
from spgf_torch.sensing.config import SensingConfig
from spgf_torch.settings import settings, typed

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT / "docs/tools"))

from command_pages import command_page, kind_of, read_settings  # noqa: E402
from paper_tables import filled  # noqa: E402

PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]
TUTORIALS = ROOT / "docs/tutorials"
FENCE = re.compile(r"^```(?P<info>[^\n]*)\n(?P<text>.*?)^```", re.DOTALL | re.MULTILINE)
COMMAND = re.compile(r"(?:python -m spgf_torch\.|^spgf )([a-z].*)", re.MULTILINE)
PATH = re.compile(r"`((?:spgf_torch|tests|conf|data|docs)/[\w./]+|[a-z]\w*/[\w/]+\.py)`")
LINK = re.compile(r"\]\(([^)\s#]+)(?:#[^)\s]*)?\)|src=\"([^\"]+)\"")


def fences(page: Path) -> Iterator[tuple[int, str, str]]:
    """Line, info string and text of each block of code."""
    content = page.read_text(encoding="utf-8")
    for found in FENCE.finditer(content):
        yield content[: found.start()].count("\n") + 1, found["info"].strip(), found["text"]


def python_blocks() -> list[Any]:
    blocks, texts = [], set()
    for page in PAGES:
        if page.parent == TUTORIALS:
            continue
        for line, info, text in fences(page):
            if not info.startswith("python") or text in texts:
                continue
            texts.add(text)
            reason = re.search(r'skip="([^"]+)"', info)
            marks = [pytest.mark.skip(reason=reason[1])] if reason else []
            blocks.append(pytest.param(text, f"{page}:{line}", id=f"{page.relative_to(ROOT)}:{line}", marks=marks))
    return blocks


def commands() -> dict[str, str]:
    """Each command that a page shows, in a block or within a line, and where."""
    found: dict[str, str] = {}
    for page in PAGES:
        content = page.read_text(encoding="utf-8")
        blocks = [text.replace("\\\n", " ") for _, info, text in fences(page) if info in ("", "sh")]
        inline = re.findall(r"`(python -m spgf_torch\.[^`]+)`", FENCE.sub("", content))
        for text in [*blocks, *inline]:
            for line in COMMAND.findall(text):
                found.setdefault(re.split(r"  +#", line)[0].strip(), str(page.relative_to(ROOT)))
    return found


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """A reader's working folder: a model, loaded once, the repository's data, images of a block on a table."""
    folder = tmp_path_factory.mktemp("reader")
    (folder / "data").symlink_to(ROOT / "data")
    depth, camera = image()
    Image.fromarray((1000 * depth).round().astype(np.uint16)).save(folder / "depth.png")
    Image.fromarray(marked(depth, camera).astype(np.uint8)).save(folder / "labels.png")
    np.savetxt(folder / "K.txt", camera.K)
    model = spgf_torch.load(ROOT / "data/models/panda")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(
            spgf_torch, "load", lambda path: {"panda": model, "latest": model, "outputs/train/latest": model}[path]
        )
        yield folder


@pytest.fixture
def names() -> dict[str, Any]:
    """What the pages call their own: a depth image, its camera, a mask, clouds in two frames."""
    depth, camera = image()
    seen = depth > 0
    T = camera.T_object_camera
    cloud = camera.rays()[seen] * depth[seen, None]
    points = cloud @ T[:3, :3].T + T[:3, 3]
    own = {"depth": depth, "K": camera.K, "T_base_camera": T, "mask": marked(depth, camera)}
    return {"__name__": "docs", "points": points, "camera": T[:3, 3], "cloud": cloud, **own}


def image() -> tuple[np.ndarray, Camera]:
    """A depth image (H, W), m, of a block on a table, 4 x 6 x 8 cm about (0, 0, 0.04)."""
    block = trimesh.creation.box((0.04, 0.06, 0.08), trimesh.transformations.translation_matrix((0, 0, 0.04)))
    table = trimesh.creation.box((0.8, 0.8, 0.02), trimesh.transformations.translation_matrix((0, 0, -0.01)))
    camera = Camera(
        intrinsics(settings(SensingConfig, width=160, height=120, focal=144)),
        look_at(np.array([0.4, 0.1, 0.45]), np.array([0, 0, 0.04])),
        160,
        120,
    )
    return cast(trimesh.util.concatenate([block, table]), camera)[0], camera


def marked(depth: np.ndarray, camera: Camera) -> np.ndarray:
    """(H, W) bool, the block."""
    points = camera.rays() * depth[..., None] @ camera.T_object_camera[:3, :3].T + camera.T_object_camera[:3, 3]
    return (depth > 0) & (points[..., 2] > 0.001)


@pytest.mark.parametrize(("text", "where"), python_blocks())
@pytest.mark.filterwarnings("ignore::UserWarning")  # a scene's notes
def test_python_blocks_run(
    text: str, where: str, place: Path, names: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(place)
    exec(compile(text, where, "exec"), names)


def test_there_are_blocks_and_commands_to_check() -> None:
    """A change of format must not leave the tests above and below with nothing to do."""
    assert len(python_blocks()) >= 5 and len(commands()) >= 25


@pytest.mark.parametrize("command", sorted(COMMANDS))
def test_commands_have_settings_that_exist(command: str) -> None:
    """Composed by Hydra and checked as the command itself does, without its work."""
    shown = {line: page for line, page in commands().items() if line.split()[0] == command}
    assert shown, f"no page shows {command}"
    kind = kind_of(command)
    for line, page in shown.items():
        try:
            check(command, kind, line)
        except Exception as error:
            pytest.fail(f"{page}: {line}: {error}")


@pytest.mark.parametrize(
    ("wrong", "told"),
    [("KK=3", "KK"), ("K=many", "many"), ("ranking=best", "ranking"), ("hand=nobody", "nobody"), ("--fast", "fast")],
)
def test_a_wrong_command_is_found(wrong: str, told: str) -> None:
    with pytest.raises(Exception, match=told):
        check("train", kind_of("train"), f"train {wrong}")


def check(command: str, kind: type, line: str) -> None:
    """Raise what the command would say to these arguments."""
    plain = re.sub(r"\$\([^)]*\)", "1/2", line.split(" > ")[0])
    plain = re.sub(r"hand[= ]\S+\.yaml", f"hand={ROOT}/conf/hand/panda.yaml", plain)  # a reader's own
    arguments = shlex.split(plain, comments=True)[1:]
    sweep = "-m" in arguments
    words = [word for word in arguments if word not in ("-m", "--help", "--json")] + ["-m"] * sweep
    overrides = translated(command, kind, as_overrides(command, kind, words))
    given = [first(word) for word in overrides if word != "-m" and not word.startswith("hydra")]
    groups = tuple(word for word in given if (ROOT / "conf" / word.split("=")[0].strip("+")).is_dir())
    values = deepcopy(composed(command, groups))
    for word in given:
        if word not in groups:
            parsed = OverridesParser.create().parse_rule(word, "override")
            *path, key = parsed.key_or_group.split(".")
            reduce(lambda inner, name: inner.setdefault(name, {}), path, values)[key] = parsed.value()
    typed(kind, values)


@cache
def composed(command: str, groups: tuple[str, ...]) -> Any:
    """The settings of a command with other files of groups; what has no default is given one."""
    needed = [f"{key}=x" for key in ("input", "objects") if required(command, key)]
    with initialize_config_dir(str(ROOT / "conf"), version_base="1.3"):
        values: Any = OmegaConf.to_container(compose(command, overrides=[*groups, *needed]), resolve=True)
    return values | ({"K": values["prototypes"]["num_clusters"]} if values.get("K") == "???" else {})


def required(command: str, key: str) -> bool:
    return re.search(rf"^{key}: \?\?\?", (ROOT / f"conf/{command}.yaml").read_text(), re.MULTILINE) is not None


def first(override: str) -> str:
    """An override without a sweep: the first of its values, or of the files that a glob finds."""
    parsed = OverridesParser.create().parse_rule(override, "override")
    if not parsed.is_sweep_override():
        return override
    prefix, key = override.split("=")[0], parsed.key_or_group
    if isinstance(parsed.value(), Glob):
        return f"{prefix}={min(path.stem for path in (ROOT / 'conf' / key).glob('*.yaml'))}"
    return f"{prefix}={next(parsed.sweep_string_iterator())}"


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_links_lead_to_files(page: Path) -> None:
    """Links within the site: `make docs` makes the pages of reference/commands from the settings."""
    targets = [a or b for a, b in LINK.findall(FENCE.sub("", page.read_text(encoding="utf-8")))]
    made = {f"docs/reference/commands/{name}.md" for name in [*COMMANDS, "index"]}
    for target in targets:
        path = (page.parent / target).resolve()
        assert path.exists() or str(path.relative_to(ROOT)) in made, f"{page.name}: {target}"


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_named_files_and_objects_exist(page: Path) -> None:
    """`spgf_torch/...`, `conf/...` and the like in the text, and what mkdocstrings is asked for."""
    text = page.read_text(encoding="utf-8")
    for name in PATH.findall(text):
        assert any((base / name).exists() for base in (ROOT, ROOT / "spgf_torch")) or re.search("[A-Z]{4}", name), name
    for name in re.findall(r"^::: (\S+)", text, re.MULTILINE):
        pkgutil.resolve_name(name)


@pytest.mark.parametrize("command", sorted(COMMANDS))
def test_every_key_of_a_command_is_on_its_page(command: str) -> None:
    page = command_page(command)
    keys = [name for name, kind in known_settings(kind_of(command), "") if not is_dataclass(kind)]
    assert keys and not [name for name in keys if f"`{name}`" not in page]


def test_every_value_has_its_reason() -> None:
    """In conf/, beside it or beside its mapping; files of +ablation= and +comparison= say theirs above.

    Descriptions of hands say theirs where they differ from what follows from the URDF; docs/howto/hand.md has all keys.
    """
    files = [*(ROOT / "conf").glob("*.yaml"), *(ROOT / "conf").glob("*/*.yaml")]
    without = []
    for path in files:
        if path.parent.name not in ("ablation", "comparison", "hand"):
            keys = read_settings(path).keys
            told = {key.name for key in keys if key.reason}
            mappings = {key.name.rpartition(".")[0] for key in keys}
            without += [
                f"{path.name}: {key.name}"
                for key in keys
                if key.name not in mappings and not {key.name, key.name.rpartition(".")[0]} & told
            ]
    assert len(files) > 20 and not without


def test_a_page_shows_default_range_and_reason_of_a_key() -> None:
    """`N: 10  # highest-ranked grasps that count (paper, section 4)`, bounded(1, 1000)."""
    row = next(line for line in command_page("train").splitlines() if line.startswith("| `N`"))
    assert row == "| `N` | `10` | whole number, 1 to 1,000 | highest-ranked grasps that count (paper, section 4) |"


def test_unknown_settings_raise_one_line() -> None:
    with pytest.raises(InputError, match="unknown key"):
        translated("train", kind_of("train"), ["KK=3"])


def test_tables_of_the_paper_come_from_a_report(tmp_path: Path) -> None:
    """What stands between the marks of a file goes, the text around them stays, also between two tables."""
    (tmp_path / "a.md").write_text("| new |\n")
    (tmp_path / "b.md").write_text("| b |\n")
    page = "x\n<!-- a.md -->\nold\n<!-- end -->\ny\n<!-- b.md -->\n<!-- end -->\nz"
    expected = "x\n<!-- a.md -->\n\n| new |\n\n<!-- end -->\ny\n<!-- b.md -->\n\n| b |\n\n<!-- end -->\nz"
    assert filled(page, tmp_path) == expected and filled(expected, tmp_path) == expected


def test_every_key_of_a_hand_is_told() -> None:
    """In the tables of docs/howto/hand.md: of a hand, of a joint and of closing, of a preshape."""
    page = (ROOT / "docs/howto/hand.md").read_text(encoding="utf-8")
    told = set(re.findall(r"^\| `([\w.]+)`", page, re.MULTILINE))
    joint = {f"joints.NAME.{entry.name}" for entry in fields(JointConfig)}
    closing = {f"closing.{entry.name}" for entry in fields(ClosingConfig)}
    whole = {entry.name for entry in fields(HandConfig)} - {"joints", "closing", "preshapes"} | {"preshapes.TYPE"}
    assert told == joint | closing | whole | {entry.name for entry in fields(PreshapeConfig)}


def test_every_check_of_a_hand_has_its_remedy() -> None:
    page = (ROOT / "docs/howto/hand.md").read_text(encoding="utf-8")
    sources = "\n".join(path.read_text(encoding="utf-8") for path in (ROOT / "spgf_torch/handcheck").glob("*.py"))
    checks = set(re.findall(r'check="([^"]+)"', sources))
    rows = {name for row in re.findall(r"^\| ([^|`]+) \|", page, re.MULTILINE) for name in row.split(", ")}
    assert len(checks) > 20 and checks <= rows, checks - rows
