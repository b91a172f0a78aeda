"""Frames of a folder, hands that close, and the page of viser asked for what it shows."""

import os
import subprocess
import sys
import time
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path
from threading import Event, Thread
from typing import Any

import numpy as np
import pytest
import trimesh
from commands import ROOT
from composing import composed

import spgf_torch
from spgf_torch.settings import typed
from spgf_torch.viewing.config import ViewConfig
from spgf_torch.viewing.frames import Folder
from spgf_torch.viewing.shown import Page, hand_mesh
from spgf_torch.viewing.watching import watch

needs_viser = pytest.mark.skipif(find_spec("viser") is None, reason="without the extra view")


def write(path: Path, content: bytes, when: int) -> Path:
    path.write_bytes(content)
    os.utime(path, ns=(when, when))
    return path


def test_a_file_is_a_frame_once_it_does_not_change(tmp_path: Path) -> None:
    folder = Folder(tmp_path)
    growing = write(tmp_path / "a.ply", b"1", 10)
    assert folder.newest() is None
    write(growing, b"12", 20)
    assert folder.newest() is None
    assert folder.newest() == growing and folder.newest() is None
    write(growing, b"34", 30)  # the same file with the next frame
    assert folder.newest() is None and folder.newest() == growing


def test_the_newest_counts_and_others_are_passed_over(tmp_path: Path) -> None:
    folder = Folder(tmp_path)
    for name, when in (
        ("b.pcd", 30),
        ("a.npy", 20),
        ("c.PNG", 10),
        ("d.txt.part", 90),
        (".e.ply", 80),
        ("readme.md", 70),
    ):
        write(tmp_path / name, b"1", when)
    write(tmp_path / "empty.ply", b"", 99)
    assert folder.newest() is None
    assert folder.newest() == tmp_path / "b.pcd" and folder.passed_over == 2
    assert folder.newest() is None


def test_a_hand_closes_between_the_places_that_are_known() -> None:
    """Two unit cubes; the second moves by 1 m along x over eight steps: half a step is 1/16 m."""
    shapes = [trimesh.creation.box(), trimesh.creation.box()]
    moves = np.tile(np.eye(4), (9, 2, 1, 1))
    moves[:, 1, 0, 3] = np.arange(9) / 8
    for closed, moved in ((0.0, 0.0), (1.0, 1.0), (0.0625, 0.0625), (0.5, 0.5)):
        vertices, faces = hand_mesh(shapes, moves, closed)
        assert vertices.shape == (16, 3) and faces.shape == (24, 3) and faces.max() == 15
        np.testing.assert_allclose(vertices[:8], shapes[0].vertices)
        np.testing.assert_allclose(vertices[8:] - shapes[1].vertices, np.tile([moved, 0, 0], (8, 1)), atol=1e-12)


def settings(**changes: Any) -> ViewConfig:
    return typed(ViewConfig, {**composed("view", "input=x"), **changes})


def ball() -> np.ndarray:
    """Points and normals of a ball of 3 cm radius on the plane z = 0."""
    outwards = np.random.default_rng(0).normal(size=(4000, 3))
    outwards /= np.linalg.norm(outwards, axis=1, keepdims=True)
    return np.hstack([0.03 * outwards + [0.2, 0.1, 0.03], outwards]).astype(np.float32)


@pytest.fixture(scope="module")
def watched(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Any, Page, Path, list[str]]]:
    """A server of viser, its page, the folder that is watched, and what is said."""
    import viser

    folder, said, stop = tmp_path_factory.mktemp("frames"), list[str](), Event()
    model = spgf_torch.load(ROOT / "data/models/panda")
    server = viser.ViserServer("127.0.0.1", 18080, verbose=False)
    page = Page(server, model, 20)
    config = settings(input=str(folder), table=[0, 0, 1, 0], every=0.05)
    thread = Thread(target=watch, args=(config, model, page, said.append, stop))
    thread.start()
    yield server, page, folder, said
    stop.set()
    thread.join()
    server.stop()


def until(holds: Any) -> None:
    for _ in range(1200):
        if holds():
            return
        time.sleep(0.05)
    raise AssertionError


@needs_viser
def test_a_frame_that_is_dropped_into_the_folder_appears(watched: Any) -> None:
    server, page, folder, said = watched
    scene = server.scene
    assert scene.get_handle_by_name("/targets") is None and "waiting" in page._words.content
    np.save(folder / "first.npy", ball())
    until(lambda: said)
    assert said[0].startswith("first.npy: 20 grasps in ")
    np.testing.assert_allclose(scene.get_handle_by_name("/targets").points.mean(axis=0), [0.2, 0.1, 0.03], atol=0.006)
    assert [scene.get_handle_by_name(f"/hands/{i}") is not None for i in range(4)] == [True] * 3 + [False]
    eye = server.initial_camera
    np.testing.assert_allclose(eye.look_at, [0.2, 0.1, 0.03], atol=0.006)
    assert 0.4 < np.linalg.norm(eye.position - eye.look_at) < 0.8 and eye.position[2] > 0.1
    best = page.shown()[0]
    colour = scene.get_handle_by_name("/hands/0").color
    assert best.probability > 0.9 and colour[1] > colour[0]  # green
    centre = scene.get_handle_by_name("/hands/0").vertices.mean(axis=0)
    behind = best.T_input_tcp[:3, 3] - centre
    assert behind @ best.T_input_tcp[:3, 2] > 0.02  # the hand lies behind its TCP, along the approach


@needs_viser
def test_sliders_choose_among_the_hands_and_close_them(watched: Any) -> None:
    server, page, _, _ = watched
    width = np.ptp(server.scene.get_handle_by_name("/hands/0").vertices @ page.shown()[0].T_input_tcp[:3, 0])
    page._count.value = 5
    assert server.scene.get_handle_by_name("/hands/4") is not None
    page._count.value = 3
    assert [server.scene.get_handle_by_name(f"/hands/{i}") is not None for i in range(5)] == [True] * 3 + [False] * 2
    page._least.value = 1.0
    assert server.scene.get_handle_by_name("/hands/0") is None and page.shown() == []
    page._least.value = 0.0
    open_hand = server.scene.get_handle_by_name("/hands/0").vertices
    page._closed.value = 1.0
    closed = server.scene.get_handle_by_name("/hands/0").vertices
    assert 0.01 < np.abs(closed - open_hand).max() < 0.05 and width > 0.05
    page._closed.value = 0.0


@needs_viser
def test_a_file_that_cannot_be_used_is_said_and_the_next_frame_shown(watched: Any) -> None:
    server, page, folder, said = watched
    before = server.scene.get_handle_by_name("/targets")
    (folder / "broken_1.ply").write_bytes(b"ply\nformat ascii 1.0\n")
    until(lambda: len(said) > 1)
    assert "broken_1.ply: expected" in said[1] and "broken\\_1\\.ply" in page._words.content
    assert server.scene.get_handle_by_name("/targets") is before
    np.save(folder / "second.npy", ball() + np.float32([0.1, 0, 0, 0, 0, 0]))
    until(lambda: len(said) > 2)
    points = server.scene.get_handle_by_name("/targets").points
    np.testing.assert_allclose(points.mean(axis=0), [0.3, 0.1, 0.03], atol=0.006)


@needs_viser
def test_the_command_watches_until_it_is_interrupted(tmp_path: Path) -> None:
    import signal

    (tmp_path / "frames").mkdir()
    command = [sys.executable, "-m", "spgf_torch", "view", "frames", "--hand", "panda", "--port", "18090"]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    with subprocess.Popen(
        command, cwd=tmp_path, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None
        said = process.stdout.readline()
        assert said.startswith("watching frames at http://127.0.0.1:180"), said
        process.send_signal(signal.SIGTERM)
        _, errors = process.communicate(timeout=60)
    assert process.returncode == 143 and errors.splitlines()[-1] == "view: ended by SIGTERM"
