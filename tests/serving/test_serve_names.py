"""What whoever asks a server reads of what it sent: by the names that it gave."""

import asyncio
from pathlib import Path
from typing import Any

import pytest
from serving_machines import settings
from starlette.requests import Request

from spgf_torch.errors import InputError
from spgf_torch.serving.bodies import LONGEST_NAME, Job, called, job_of
from spgf_torch.serving.predicting import _as_called


@pytest.mark.parametrize(
    ("filename", "expected"),
    [
        ("mug one.ply", "mug one.ply"),
        ("../../etc/mug.ply", "mug.ply"),
        ("C:\\scans\\mug.ply", "mug.ply"),
        ("a\x1b[31m\nb.ply", "a[31mb.ply"),
        ("x" * 200, "x" * LONGEST_NAME),
        ("scans/", "mask"),
        (None, "mask"),
    ],
)
def test_a_part_is_called_by_its_files_name(filename: str | None, expected: str) -> None:
    assert called(filename, "mask") == expected


def job(folder: Path, body: bytes, kind: str) -> Job:
    """What a request of this body asks for."""

    async def receive() -> Any:
        return {"type": "http.request", "body": body, "more_body": False}

    scope = {"type": "http", "method": "POST", "query_string": b"", "headers": [(b"content-type", kind.encode())]}
    return asyncio.run(job_of(Request(scope, receive), folder, settings()))


def test_files_lie_under_our_names_and_are_told_by_theirs(tmp_path: Path) -> None:
    part = '--m\r\nContent-Disposition: form-data; name="{}"; filename="{}"\r\n\r\nply\r\n'
    body = "".join(part.format(*each) for each in (("input", "../left.ply"), ("input", "right.ply"), ("mask", "m.png")))
    got = job(tmp_path, f"{body}--m--\r\n".encode(), "multipart/form-data; boundary=m")
    assert got.files == {"input": ["input.ply", "input_2.ply"], "mask": ["mask.png"]}
    assert got.called == {"input.ply": "left.ply", "input_2.ply": "right.ply", "mask.png": "m.png"}
    words = f"{tmp_path}/input_2.ply: as {tmp_path}/input.ply has it, not {tmp_path}/mask.png; {tmp_path}/other"
    assert _as_called(words, got) == "right.ply: as left.ply has it, not m.png; other"


def test_a_body_is_called_so(tmp_path: Path) -> None:
    got = job(tmp_path, b'{"points": [[0, 0, 0]]}', "application/json")
    assert got.arrays and (tmp_path / "input.json").is_file()
    assert _as_called(f"{tmp_path}/input.json: expected", got) == "body: expected"


def test_a_part_without_a_byte_is_told_by_its_key(tmp_path: Path) -> None:
    """As a page's form sends a field that nobody filled in."""
    part = '--m\r\nContent-Disposition: form-data; name="{}"; filename="{}"\r\n\r\n{}\r\n'
    body = part.format("input", "mug.ply", "ply") + part.format("intrinsics", "", "")
    with pytest.raises(InputError, match="intrinsics: expected a file with something in it, got one, empty"):
        job(tmp_path, f"{body}--m--\r\n".encode(), "multipart/form-data; boundary=m")
