"""Files that carry a digest of themselves: a bit that changed since writing is detected on reading.

A seal is one word in a file, `spgf-sha256:HEX:spgf-sha256`, wherever its format has room for a word: HEX is the SHA-256
of the whole file with 64 zeros in HEX's place. Its two ends are marks: whatever one bit changes, a mark is left, and a
mark without its whole seal is damage. So a seal needs no file beside it, and no order of two writes.

Files without a seal are held to `SHA256SUMS` beside them, if there is one (`sha256sum * >SHA256SUMS` makes it, and
`sha256sum -c SHA256SUMS` checks it). A seal is no signature: it finds damage and edits, not malice.
"""

from __future__ import annotations

import hashlib
import json
import mmap
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from spgf_torch.errors import InputError, one_line

MARK = b"spgf-sha256"
ZEROS = b"0" * 64
BLANK = MARK + b":" + ZEROS + b":" + MARK  # where the seal of a file is to stand
KEY = "seal"  # of it in JSON, and in the metadata of other formats
SUMS = "SHA256SUMS"
LARGEST_SUMS = 16_000_000  # bytes: a hundred thousand files
ENDS = 1 << 20  # bytes at either end of a file in which its seal stands

_SEAL = re.compile(MARK + b":([0-9a-f]{64}):" + MARK)
_LINE = re.compile(r"([0-9a-f]{64}) [ *]([^/]+)")
_reported: set[Path] = set()  # folders of folders of which it was said that files in them carry no digest


def sealed(content: bytes) -> bytes:
    """`content`, in which `BLANK` stands once, with its seal there."""
    before, blank, after = content.partition(BLANK)
    if not blank or MARK in before or MARK in after:
        raise ValueError(f"a seal: expected {BLANK.decode()} once")
    digest = hashlib.sha256(content).hexdigest().encode()
    return before + BLANK.replace(ZEROS, digest) + after


def sealed_json(values: Mapping[str, Any], **how: Any) -> bytes:
    """JSON text of `values` with its seal as one more key, `seal`; `how` goes to `json.dumps`."""
    return sealed(json.dumps({**values, KEY: BLANK.decode()}, **how).encode() + b"\n")


def sealed_yaml(text: str) -> bytes:
    """YAML text with its seal in a comment at the end."""
    return sealed(text.encode() + b"# " + BLANK + b"\n")


def check_seal(path: Path, what: str) -> bool:
    """Whether the file carries a seal, which is then right. For one without any digest a line is printed, once.

    Raises InputError in one line where the file, which should be `what`, is not as it was written.
    """
    try:
        with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as content:
            seal = _sealed_with(content)
            if seal is not None and seal != _digest_without(content, seal):
                raise _changed(path, what)
    except InputError:
        raise
    except (OSError, ValueError) as error:  # ValueError: empty
        raise InputError(f"{path}: expected {what}, got {getattr(error, 'strerror', None) or error}") from None
    if seal is not None:
        return True
    listed = sums_of(path.parent / SUMS)
    if listed is None:
        _tell(path)
        return False
    if path.name not in listed:
        raise InputError(f"{path}: expected a file that {SUMS} beside it lists, got one that is missing in it")
    if listed[path.name] != digest_of(path):
        raise _changed(path, what)
    return False


def is_sealed(path: Path) -> bool:
    """Whether there is a seal in the file, right or not."""
    with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as content:
        return _sealed_with(content) is not None


def digest_of(path: Path) -> str:
    """SHA-256 of a file, in hexadecimal digits."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def sums_of(path: Path) -> dict[str, str] | None:
    """File name -> SHA-256, as `sha256sum` writes it; None where there is no such file."""
    if not path.is_file():
        return None
    try:
        size = path.stat().st_size
        *lines, rest = path.read_bytes().decode().split("\n") if size <= LARGEST_SUMS else [""]
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: expected digests of files, got {error}") from None
    found = [_LINE.fullmatch(line) for line in lines]
    listed = {match[2]: match[1] for match in found if match}
    if not found or rest or len(listed) < len(found):
        got = f"{size} bytes" if not found else "a damaged line, or a file twice"
        raise InputError(f"{path}: expected a SHA-256, two blanks and a file name in each line, got {got}")
    return listed


def _sealed_with(content: mmap.mmap) -> bytes | None:
    """The digits of the seal; None where there is no mark of one, no digits where it is damaged."""
    size = len(content)
    ends = content[:] if size <= 2 * ENDS else content[:ENDS] + content[size - ENDS :]
    if MARK not in ends:
        return None
    seals = _SEAL.findall(ends)
    return seals[0] if len(seals) == 1 and ends.count(MARK) == 2 else b""


def _digest_without(content: mmap.mmap, seal: bytes) -> bytes:
    """The digits of the file's SHA-256 with zeros in the place of `seal`; for a damaged seal other words."""
    if not seal:
        return b"damaged"
    mark = MARK + b":" + seal
    start = content.find(mark) if content.find(mark) < ENDS else content.rfind(mark)
    start += len(mark) - len(seal)
    with memoryview(content) as view:
        sha = hashlib.sha256(view[:start])
        sha.update(ZEROS)
        sha.update(view[start + len(seal) :])
    return sha.hexdigest().encode()


def _changed(path: Path, what: str) -> InputError:
    return InputError(
        f"{path}: expected {what} as it was written, got a damaged or edited one (its SHA-256 is another): "
        "copy it again from where it came, or make it again"
    )


def _tell(path: Path) -> None:
    """One line, however many files beside each other it concerns."""
    around = path.absolute().parent.parent
    if around not in _reported:
        from spgf_torch.progress import console  # brings rich

        _reported.add(around)
        words = "written by an older version: damage to it, or to others beside it, is not noticed"
        console.print(one_line(f"no digest in {path}, {words}"), markup=False)
