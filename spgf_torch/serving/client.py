"""A client of `spgf serve` in one file: Python 3.8 or later and its standard library; copy it to a robot.

    from client import Client

    grasps = Client("http://127.0.0.1:8000").grasps(points=cloud, viewpoint=(0, 0, 0), table="find")
    for grasp in grasps["grasps"]:
        print(grasp["type"], grasp["probability"], grasp["T_input_tcp"])

Points and images are lists or numpy arrays. As a command: python client.py mug.ply --viewpoint 0 0 0 --table find
"""

from __future__ import annotations

import argparse
import json
import os
import struct
import sys
import urllib.error
import urllib.parse
import urllib.request
import uuid
from array import array
from pathlib import Path
from typing import Any

URL = "http://127.0.0.1:8000"


class ServeError(Exception):
    """The server cannot be reached, or it refused what was asked, or a file cannot be read; in one line.

    Attributes:
        status: of the answer, such as 400 (what was sent cannot be used, or to be sent not be read) or 503 (ask
            again); None: there was none.
        retry_after: s after which to ask again; None: not said.
    """

    def __init__(self, line: str, status: int | None = None, retry_after: float | None = None) -> None:
        super().__init__(line)
        self.status, self.retry_after = status, retry_after


class Client:
    """Asks a server for grasps.

    Args:
        url: where it is, http://HOST:PORT. timeout: s to wait for an answer.

    Raises:
        ValueError: another kind of url.
    """

    def __init__(self, url: str = URL, timeout: float = 60.0) -> None:
        if not isinstance(url, str) or not url.startswith(("http://", "https://")):
            raise ValueError(f"url: expected http://HOST:PORT, got {url!r:.60}")
        self.url, self.timeout = url.rstrip("/"), timeout

    def grasps(
        self,
        points: Any = None,
        depth: Any = None,
        K: Any = None,
        file: Any = None,
        T_input_camera: Any = None,
        **settings: Any,
    ) -> dict[str, Any]:
        """Ranked grasps, best first, as the dictionary of grasps.json: `answer["grasps"][0]["T_input_tcp"]`.

        Args:
            points: (N, 3) or (H, W, 3), m. depth: (H, W): fractions are m, whole numbers counts of depth_scale (mm).
            K: 3 x 3, or fx, fy, cx, cy.
            file: path of a cloud, a mesh or a depth image (then K, or intrinsics= a file), or a list of paths of views.
            T_input_camera: (4, 4) pose of the depth image's camera, m.
            settings: top (grasps of each type), types (NPG,WPG), viewpoint (x, y, z), table (find, or a, b, c, d),
                crop_low, crop_high, unit and others that /docs lists; mask, segments: arrays in the shape of the
                input, or paths; normals: array in the shape of the points; intrinsics, poses: paths.

        Raises:
            ServeError: no server there, or it refused, or a file cannot be read; `status` says why.
            ValueError: an argument that cannot be sent, in one line that names it.
        """
        given = [name for name, value in (("points", points), ("depth", depth), ("file", file)) if value is not None]
        if len(given) != 1:
            raise ValueError(f"expected one of points, depth and file, got {' and '.join(given) or 'none'}")
        parts: list[tuple[str, str, bytes]] = []
        if points is not None:
            parts.append(("input", "points.npy", _npy("points", points)))
            if settings.get("normals") is not None:
                return self._with_normals(points, settings)
        elif depth is not None:
            parts.append(("input", "depth.npy", _npy("depth", depth)))
        else:
            parts += [_file("input", each) for each in (file if isinstance(file, (list, tuple)) else [file])]
        if K is not None:
            settings["intrinsics"] = _numbers("K", K)
        if T_input_camera is not None:
            pose = _words("T_input_camera", {"T_input_camera": _nested(T_input_camera)})
            parts.append(("poses", "poses.json", pose.encode()))
        for name in ("mask", "segments", "intrinsics", "poses"):
            value = settings.get(name)
            if isinstance(value, (str, os.PathLike)):
                parts.append(_file(name, settings.pop(name)))
            elif value is not None and name in ("mask", "segments"):
                parts.append((name, name + ".npy", _npy(name, settings.pop(name), whole=True)))
        words = [(name, _words(name, value)) for name, value in settings.items() if value is not None]
        body, kind = _form(words, parts)
        return self._asked("/grasps", body, kind)

    def _with_normals(self, points: Any, settings: dict[str, Any]) -> dict[str, Any]:
        """Points with normals, as JSON: a .npy file has no place for both that keeps an image's shape."""
        named = {name: _nested(value) for name, value in settings.items() if value is not None}
        body = _words("points", {"points": _nested(points), **named}).encode()
        return self._asked("/grasps", body, "application/json")

    def health(self) -> dict[str, Any]:
        """Whether the server is ready, and which model it has. Raises ServeError where it is not."""
        return self._asked("/health")

    def page(self, answer: dict[str, Any]) -> str:
        """The address of the page of an answer, for a browser."""
        return self.url + answer["page"]

    def _asked(self, path: str, body: bytes | None = None, kind: str = "") -> dict[str, Any]:
        opener = urllib.request.build_opener(urllib.request.ProxyHandler({}))  # the server is near
        headers = {"Content-Type": kind} if kind else {}
        try:
            request = urllib.request.Request(self.url + path, data=body, headers=headers)
            with opener.open(request, timeout=self.timeout) as answer:
                return json.loads(answer.read().decode())
        except urllib.error.HTTPError as error:
            after = error.headers.get("Retry-After")
            raise ServeError(_line(error), error.code, float(after) if after else None) from None
        except (OSError, ValueError) as error:  # ValueError: an answer that is no JSON
            reason = getattr(error, "reason", None) or error
            words = getattr(reason, "strerror", None) or reason
            remedy = "; is it there? (spgf serve --hand NAME)" if isinstance(reason, ConnectionError) else ""
            raise ServeError(f"{self.url}: expected an answer of spgf serve, got {words}{remedy}") from None


def _line(error: urllib.error.HTTPError) -> str:
    """What the server says is wrong."""
    try:
        return str(json.loads(error.read().decode())["error"])
    except (OSError, ValueError, KeyError, TypeError):
        return f"HTTP status {error.code}"


def _nested(values: Any) -> Any:
    """Arrays, and whatever else has tolist(), as lists; what is none is left."""
    if hasattr(values, "tolist"):
        return values.tolist()
    return [_nested(each) for each in values] if isinstance(values, (list, tuple)) else values


def _flat(name: str, values: Any) -> tuple[list[Any], tuple[int, ...]]:
    """The numbers of nested lists, and their shape."""
    shape: list[int] = []
    level = [_nested(values)]
    while level and isinstance(level[0], (list, tuple)):
        length = len(level[0])
        if any(not isinstance(each, (list, tuple)) or len(each) != length for each in level):
            raise ValueError(f"{name}: expected rows of one length")
        shape.append(length)
        level = [value for each in level for value in each]
    if not shape or any(isinstance(value, str) for value in level):
        raise ValueError(f"{name}: expected an array of numbers")
    return level, tuple(shape)


def _npy(name: str, values: Any, whole: bool = False) -> bytes:
    """A numpy file (.npy): the bytes of an array as they are, or float32 or int32 of lists."""
    if hasattr(values, "__array_interface__"):
        values = values.astype(values.dtype.newbyteorder("<"))
        kind, shape, content = values.dtype.str, values.shape, values.tobytes()
        if values.dtype.kind == "b":
            kind = "|u1"
    else:
        numbers, shape = _flat(name, values)
        counts = whole or (name == "depth" and all(isinstance(value, int) for value in numbers))
        kind = "<i4" if counts else "<f4"
        try:
            made = array("i" if counts else "f", [float("nan") if value is None else value for value in numbers])
        except (TypeError, OverflowError) as error:
            raise ValueError(
                f"{name}: expected {'whole ' * counts}numbers in rows of one length, got {error}"
            ) from None
        if sys.byteorder == "big":
            made.byteswap()
        content = made.tobytes()
    sides = "".join(f"{side}, " for side in shape)
    head = f"{{'descr': '{kind}', 'fortran_order': False, 'shape': ({sides}), }}"
    head += " " * (-(len(head) + 11) % 64) + "\n"
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(head)) + head.encode("latin-1") + content


def _file(name: str, path: Any) -> tuple[str, str, bytes]:
    if not isinstance(path, (str, os.PathLike)):
        raise ValueError(f"{name}: expected the path of a file, got {type(path).__name__}")
    try:
        return name, Path(path).name, Path(path).read_bytes()
    except (OSError, ValueError) as error:  # ValueError: a name with a NUL
        raise ServeError(f"{path}: expected a file, got {getattr(error, 'strerror', error)}", 400) from None


def _numbers(name: str, values: Any) -> Any:
    """K as nested lists, unless it is a file's path."""
    return values if isinstance(values, (str, os.PathLike)) else _nested(values)


def _words(name: str, value: Any) -> str:
    """A setting as text: words as they are, all else as JSON."""
    try:
        return value if isinstance(value, str) else json.dumps(_nested(value))
    except (TypeError, ValueError):
        raise ValueError(f"{name}: expected numbers or words, got {type(value).__name__}") from None


def _form(words: list[tuple[str, str]], parts: list[tuple[str, str, bytes]]) -> tuple[bytes, str]:
    """A body of multipart/form-data, and its type."""
    mark = uuid.uuid4().hex
    lines = []
    for name, value in words:
        lines.append(f'--{mark}\r\nContent-Disposition: form-data; name="{name}"\r\n\r\n{value}\r\n')
    body = "".join(lines).encode()
    for name, called, content in parts:
        safe = called.replace("\\", "_").replace('"', "_").replace("\r", "_").replace("\n", "_")
        said = f'Content-Disposition: form-data; name="{name}"; filename="{safe}"'
        body += f"--{mark}\r\n{said}\r\n\r\n".encode() + content + b"\r\n"
    return body + f"--{mark}--\r\n".encode(), f"multipart/form-data; boundary={mark}"


class _Parser(argparse.ArgumentParser):
    """One that says in one line what is wrong."""

    def error(self, message: str) -> Any:
        self.exit(2, f"client: {message}\n")


# What Client.grasps is given in a program, and nobody can type.
_PYTHON = ("points", "depth", "normals", "file", "T_input_camera")
# Settings that are three numbers, whatever follows them.
_PLACES = ("viewpoint", "viewpoints", "crop_low", "crop_high")


def _asked_for(words: list[str]) -> tuple[list[str], dict[str, Any]]:
    """Files, and settings as keyword arguments; ValueError for what is neither."""
    files: list[str] = []
    given: dict[str, list[Any]] = {}
    while words:
        word = words.pop(0)
        if not word.startswith("-"):
            files.append(word)
            continue
        key, equals, value = word.partition("=")
        name = key.lstrip("-").replace("-", "_")
        if not name or name in _PYTHON:
            raise ValueError(f"{key}: expected files as words, and settings of the scene as --KEY VALUE")
        if not equals and (not words or words[0].startswith("--")):
            raise ValueError(f"{key}: expected a value after it, got {words[0] if words else 'none'}")
        value = value if equals else words.pop(0)
        values = value.split(",")
        while not equals and _are_numbers(values) and words and _are_numbers([words[0]]):
            values.append(words.pop(0))
        several = len(values) > 1 and _are_numbers(values)
        if name in _PLACES and not value.startswith("[") and not (several and len(values) == 3):
            raise ValueError(
                f"{key}: expected 3 numbers after it, got {' '.join([*values, *words[: 3 - len(values)]])}"
            )
        given.setdefault(name, []).append([float(each) for each in values] if several else ",".join(values))
    for name, values in given.items():
        if len(values) > 1 and not all(isinstance(each, list) for each in values):
            raise ValueError(f"--{name}: expected one value, got {' and '.join(map(str, values))}")
    if given and not files:
        raise ValueError(f"expected a file with --{next(iter(given))}, got none")
    return files, {name: values if len(values) > 1 else values[0] for name, values in given.items()}


def _are_numbers(words: list[str]) -> bool:
    try:
        return bool([float(word) for word in words])
    except ValueError:
        return False


def main() -> int:
    """Ask for grasps on files and print the answer as JSON.

    The status is 2 where what was asked or sent cannot be used, 1 where there is no server or it could not answer.
    """
    parser = _Parser(
        usage="%(prog)s [FILE ...] [--KEY VALUE ...] [--url URL] [--timeout S]",
        description="Grasps from spgf serve on a cloud, a mesh, a depth image or views; no file: is it ready?",
        epilog="--KEY VALUE: settings of the scene, such as --viewpoint 0 0 0 --table find.",
        allow_abbrev=False,
    )
    parser.add_argument("--url", default=URL, help="of the server, %(default)s without")
    parser.add_argument("--timeout", type=float, default=60.0, metavar="S", help="s to wait for the answer")
    known, rest = parser.parse_known_args()
    try:
        client = Client(known.url, known.timeout)
        files, settings = _asked_for(rest)
        answer = client.grasps(file=files, **settings) if files else client.health()
    except ServeError as error:
        print(f"client: {error}", file=sys.stderr)
        return 2 if error.status is not None and 400 <= error.status < 500 else 1
    except ValueError as error:
        parser.error(str(error))
    try:
        print(json.dumps(answer), flush=True)
    except BrokenPipeError:  # whoever reads has enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    return 0


if __name__ == "__main__":
    sys.exit(main())
