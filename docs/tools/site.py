"""Hooks of MkDocs (mkdocs.yml): pages made from the program, and files of the repository outside docs/.

Generated: a page a command (`command_pages`), a page a sub-package (its docstring and its modules, by mkdocstrings).
Brought in: what pages link to beside docs/. Links are relative to where a file lies in the repository, so that they
work in a checkout as well as on the site.
"""

from __future__ import annotations

import os.path
import re
import sys
from pathlib import Path, PurePosixPath
from typing import Any

sys.path.insert(0, str(Path(__file__).parent))
sys.path.insert(1, str(Path(__file__).parents[2]))

from command_pages import pages as command_pages
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

ROOT = Path(__file__).parents[2]
PACKAGE = ROOT / "spgf_torch"
# Files beside docs/ that pages show or link to, and where they stand on the site.
BROUGHT = "repository"
FILES = ("CONTRIBUTING.md", "CHANGELOG.md", "data/objects/README.md", "data/objects/contact_sheet.png")
FOLDERS = ("data/report",)
# Entries of `nav` in mkdocs.yml in whose place the generated pages stand.
PACKAGES, COMMANDS = "generated: packages", "generated: commands"
# What tests are told of a block, such as skip="needs a scene": with it the site's Markdown would take no block for one.
_TOLD = re.compile(r"^(```python) skip=.*$", re.MULTILINE)
_LINK = re.compile(r"(\]\()([^)\s#:]+)(#[^)\s]*)?(\))")


def on_config(config: MkDocsConfig) -> MkDocsConfig:
    """Put the generated pages into the navigation."""
    packages = [{name: f"reference/api/{name}.md"} for name in package_names()]
    named = {"index": "All commands"}
    commands = [{named.get(name, name): f"reference/commands/{name}.md"} for name, _ in _commands()]
    config.nav = _filled(config.nav, {PACKAGES: packages, COMMANDS: commands})
    return config


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add generated pages and brought files."""
    for name in package_names():
        files.append(File.generated(config, f"reference/api/{name}.md", content=package_page(name)))
    for name, text in _commands():
        files.append(File.generated(config, f"reference/commands/{name}.md", content=text))
    for path in brought():
        files.append(File.generated(config, f"{BROUGHT}/{path}", abs_src_path=str(ROOT / path)))
    return files


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Links as they are in the repository, turned into those of the site; blocks without what tests are told."""
    uri = page.file.src_uri
    inside = uri.startswith(f"{BROUGHT}/")
    here = PurePosixPath(uri).relative_to(BROUGHT) if inside else PurePosixPath("docs") / uri

    def turned(found: re.Match[str]) -> str:
        target = os.path.normpath(here.parent / found[2]).replace(os.sep, "/")
        if target.startswith("docs/"):
            there = target.removeprefix("docs/")
        elif target in brought():
            there = f"{BROUGHT}/{target}"
        else:
            return found[0]
        return f"{found[1]}{os.path.relpath(there, PurePosixPath(uri).parent)}{found[3] or ''}{found[4]}"

    return _TOLD.sub(r"\1", _LINK.sub(turned, markdown))


def brought() -> list[str]:
    """The brought files, as paths in the repository."""
    pictures = [path.relative_to(ROOT).as_posix() for name in FOLDERS for path in sorted((ROOT / name).glob("*.png"))]
    return [*FILES, *pictures]


def package_names() -> list[str]:
    """The sub-packages, by name."""
    return sorted(path.parent.name for path in PACKAGE.glob("[a-z]*/__init__.py"))


def package_page(name: str) -> str:
    """The page of a sub-package: what its `__init__` says, then each of its modules."""
    modules = sorted(
        ".".join(path.relative_to(ROOT).with_suffix("").parts)
        for path in (PACKAGE / name).rglob("*.py")
        if path.stem != "__init__" and not path.stem.startswith("_")
    )
    lines = [f"# {name}", "", f"::: spgf_torch.{name}", "    options:", "      members: false", ""]
    for module in modules:
        short = module.removeprefix(f"spgf_torch.{name}.")
        lines += [f"## {short}", "", f"::: {module}", ""]
    return "\n".join(lines)


def _commands() -> list[tuple[str, str]]:
    if not _MADE:
        _MADE.extend(command_pages())
    return _MADE


_MADE: list[tuple[str, str]] = []


def _filled(nav: Any, parts: dict[str, list[Any]]) -> Any:
    """The navigation with each entry of `parts` in the place of its name."""
    if isinstance(nav, list):
        places = [parts[entry] if isinstance(entry, str) and entry in parts else [entry] for entry in nav]
        return [_filled(entry, parts) for entries in places for entry in entries]
    if isinstance(nav, dict):
        return {title: _filled(entry, parts) for title, entry in nav.items()}
    return nav
