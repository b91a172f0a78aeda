"""Folders of objects as people have them on disk: what each is taken for, and one line for each way to be wrong."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from composing import composed
from omegaconf import OmegaConf

from spgf_torch.cache import Cache
from spgf_torch.cli.command import slug
from spgf_torch.errors import InputError
from spgf_torch.experiment.config import TrainConfig
from spgf_torch.hands.config import HandConfig
from spgf_torch.objects import piece_cache
from spgf_torch.objects.config import CLASSES, CollisionConfig, ObjectsConfig
from spgf_torch.objects.folders import Objects, read_objects
from spgf_torch.objects.layouts import recognise
from spgf_torch.objects.manifest import CATEGORIES
from spgf_torch.objects.scans import NOTHING_KEPT
from spgf_torch.paths import root
from spgf_torch.progress import ProgressReporter
from spgf_torch.settings import settings, typed
from spgf_torch.simulation.config import SimulateConfig

SIZE = np.array((0.06, 0.04, 0.10))


def box(scale: float = 1.0, inverted: bool = False) -> trimesh.Trimesh:
    mesh = trimesh.creation.box(SIZE * scale)
    return trimesh.Trimesh(mesh.vertices, mesh.faces[:, ::-1], process=False) if inverted else mesh


def lay(root: Path, *files: str, scale: float = 1.0, inverted: bool = False) -> Path:
    """`root` with the same box in every file; of a finer resolution it has more faces."""
    for file in files:
        (root / file).parent.mkdir(parents=True, exist_ok=True)
        box(scale, inverted).export(root / file)
    return root


def read(folder: Path, category: str = "boxes", cache: Cache = NOTHING_KEPT, **changes: Any) -> Objects:
    values = {"objects": str(folder), "unit": "auto", "category": category, "skip_bad": False, "workers": 1}
    collision = settings(CollisionConfig, samples=10_000)
    config = typed(ObjectsConfig, {**values, "hand": settings(HandConfig), "collision": collision, **changes})
    return read_objects(config, ProgressReporter(), cache)


def refused(folder: Path, message: str, **changes: Any) -> None:
    """One line that matches."""
    with pytest.raises(InputError, match=message) as error:
        read(folder, **changes)
    assert "\n" not in str(error.value)


YCB = ("001_a/google_16k/nontextured.stl", "065-h_cups/tsdf/textured.obj", "065-h_cups/poisson/nontextured.ply")
KIT = ("Amicelli/meshes/Amicelli_Orig.obj", "Amicelli/meshes/Amicelli_5k_tex.obj", "Cup/meshes/Cup_800_tex.obj")


@pytest.mark.parametrize(
    ("files", "scale", "names", "note"),
    [
        (YCB, 1, ["001_a", "065-h_cups"],
         "YCB layout, 2 objects, unit m: google_16k/nontextured.stl (1), poisson/nontextured.ply (1)"),
        (KIT, 1000, ["Amicelli", "Cup"], "KIT layout, 2 objects, unit mm: _5k_tex.obj (1), _800_tex.obj (1)"),
        (("Mug/meshes/model.obj", "Toy/model.obj", "Toy/model_collision_0.obj"), 1, ["Mug", "Toy"],
         "Google Scanned Objects layout, 2 objects, unit m: meshes/model.obj (1), model.obj (1)"),
        (("A0.obj", "G6.obj", "G08_2.obj"), 40, ["A0", "G08_2", "G6"],
         "EGAD layout, 3 objects, scaled to the hand's 95 mm: .obj (3)"),
        (("my mug.STL", "can.ply", "can.obj", "A0.obj"), 1, ["A0", "can", "my_mug"],
         "flat layout, 3 objects, unit m: .obj (1), .ply (1), .STL (1)"),
    ],
)  # fmt: skip
def test_layouts_are_recognised(tmp_path: Path, files: tuple, scale: float, names: list, note: str) -> None:
    """A box of 6 x 4 x 10 cm each time; EGAD's own protocol makes 57 x 38 x 95 mm of it for 95 mm."""
    found = read(lay(tmp_path, *files, scale=scale))
    assert found.notes == [f"{tmp_path}: {note}"]
    assert [obj.name for obj in found.objects] == names == [scan.object.name for scan in found.scans]
    size = SIZE * 0.95 if note.startswith("EGAD") else SIZE
    assert all(np.allclose(obj.mesh.extents, size, rtol=1e-5) for obj in found.objects)
    assert all(obj.category == "boxes" for obj in found.objects)


@pytest.mark.parametrize(
    ("files", "taken"),
    [
        (["google_512k/nontextured.ply", "google_64k/textured.obj", "tsdf/nontextured.ply"], "google_64k/textured.obj"),
        (["google_16k/textured.obj", "google_16k/nontextured.stl", "google_64k/nontextured.ply"],
         "google_16k/nontextured.stl"),
        (["google_16k/nontextured.stl", "google_16k/nontextured.ply"], "google_16k/nontextured.ply"),
        (["tsdf/textured.obj", "poisson/textured.obj"], "poisson/textured.obj"),
    ],
)  # fmt: skip
def test_the_preferred_file_of_a_ycb_object_is_taken(tmp_path: Path, files: list[str], taken: str) -> None:
    found = recognise(lay(tmp_path, *(f"011_banana/{file}" for file in files)))
    assert found.files == {"011_banana": tmp_path / "011_banana" / taken}


@pytest.mark.parametrize(
    ("sizes", "taken"),
    [
        ("Orig 800 5k_tex 25k_tex", "25k_tex"),
        ("25k_tex 25k", "25k"),
        ("800 Orig 5k", "5k"),
        ("800 Orig_tex", "Orig_tex"),
    ],
)
def test_the_preferred_file_of_a_kit_object_is_taken(tmp_path: Path, sizes: str, taken: str) -> None:
    found = recognise(lay(tmp_path, *(f"Cup/meshes/Cup_{size}.obj" for size in sizes.split())))
    assert found.files == {"Cup": tmp_path / f"Cup/meshes/Cup_{taken}.obj"}


def test_the_unit_of_a_layout_can_be_overruled(tmp_path: Path) -> None:
    """Of EGAD's prepare_meshes.py output, too: it has a unit."""
    refused(lay(tmp_path / "kit", *KIT), "Amicelli_5k_tex.obj: .* got 0.0001 m with unit=mm; unit=m would fit")
    assert np.allclose(read(tmp_path / "kit", unit="m").objects[0].mesh.extents, SIZE)
    found = read(lay(tmp_path / "egad", "A0.obj", scale=1000), unit="mm")
    assert np.allclose(found.objects[0].mesh.extents, SIZE) and found.notes[0].endswith("unit mm: .obj (1)")


def test_an_inverted_mesh_is_turned_and_said(tmp_path: Path) -> None:
    found = read(lay(tmp_path, "Cup/meshes/Cup_5k.obj", scale=1000, inverted=True))
    assert found.objects[0].mesh.volume > 0
    assert found.notes[1:] == [f"mended: {tmp_path}/Cup/meshes/Cup_5k.obj: 12 of 12 faces turned outwards"]


def test_a_bad_mesh_is_refused_or_skipped(tmp_path: Path) -> None:
    lay(tmp_path, "a.ply", "c.ply", "d.ply")
    (tmp_path / "b.ply").write_bytes(b"ply\n")
    lay(tmp_path, "d.ply", scale=1000)
    refused(
        tmp_path,
        r"b.ply: expected a PLY header that ends with end_header, .*\(skip_bad=true goes on without it\)",
    )
    found = read(tmp_path, skip_bad=True)
    assert [obj.name for obj in found.objects] == ["a", "c"] == [scan.object.name for scan in found.scans]
    assert [note.split(":")[0] for note in found.notes[1:]] == ["left out", "left out"]
    assert "b.ply" in found.notes[1] and "unit=mm would fit" in found.notes[2]
    (tmp_path / "a.ply").unlink()
    (tmp_path / "c.ply").unlink()
    refused(tmp_path, "expected a mesh that can be used, got none; left out: .*b.ply", skip_bad=True)


def manifest(folder: Path, *lines: str) -> Path:
    (folder / "manifest.csv").write_text("\n".join(lines))
    return folder


def test_a_manifest_names_files_classes_and_masses(tmp_path: Path) -> None:
    """The order is by name; a class that is not given is `category`; other columns and other meshes do not matter."""
    lay(tmp_path, "sub/pack.ply", "brick.ply", "cup.ply", "other.ply")
    lines = ["name,file,class,mass,note", "pack,sub/pack.ply,box,,a carton", "brick,brick.ply,, 0.5 ,"]
    found = read(manifest(tmp_path, *lines, "cup,cup.ply,container"), category="curved")
    assert [obj.name for obj in found.objects] == ["brick", "cup", "pack"]
    assert [obj.category for obj in found.objects] == ["curved", "containers", "boxes"]
    assert found.objects[0].mass == 0.5
    assert found.notes == [f"{tmp_path}: manifest.csv, 3 objects, unit m"]


def test_a_manifest_may_choose_and_class_objects_of_a_layout(tmp_path: Path) -> None:
    lay(tmp_path, *YCB, "002_b/google_16k/nontextured.ply")
    found = read(manifest(tmp_path, "name,class,mass", "065-h_cups,container,0.03", "001_a,box"), category="manifest")
    assert [(obj.name, obj.category) for obj in found.objects] == [("001_a", "boxes"), ("065-h_cups", "containers")]
    assert found.objects[1].mass == 0.03 and "YCB layout, 2 objects" in found.notes[0]
    manifest(tmp_path, "name,class", "003_c,box")
    refused(tmp_path, "manifest.csv:2: name: expected an object of the YCB layout beside it, got 003_c")


def test_every_class_of_the_manifest_is_a_class_of_the_paper() -> None:
    assert tuple(CATEGORIES.values()) == CLASSES


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("cup,box.ply,cupboard", r"manifest.csv:2: class: expected one of container, box, curved; got 'cupboard'"),
        ("cup,none.ply,box", r"none.ply: expected the mesh that .*manifest.csv:2 lists, got nothing there"),
        ("a/b,box.ply,box", r"manifest.csv:2: name: expected letters, digits, _ and -, got 'a/b'"),
        ("..,box.ply,box", r"manifest.csv:2: name: expected letters, digits, _ and -, got '..'"),
        ("cup,../box.ply,box", r"manifest.csv:2: file: expected a .* got '../box.ply'"),
        ("cup,box.txt,box", r"manifest.csv:2: file: expected a .ply/.* got 'box.txt'"),
        ("cup,,box", r"manifest.csv:2: file: expected a .ply/.* got ''"),
        ("cup,box.ply,box\ncup,box.ply,box", r"manifest.csv:3: expected each name once, got cup again \(line 2\)"),
        ("cup,box.ply", r"expected a class for cup: category=containers\|boxes\|curved for all, or a manifest.csv"),
        ("", r"manifest.csv: expected one line a mesh, got none"),
        *((f"cup,box.ply,box,{mass}", f"manifest.csv:2: mass: expected kilograms above 0, got '{mass}'")
          for mass in ("heavy", "0", "-1", "nan", "inf")),
    ],
)  # fmt: skip
def test_a_wrong_manifest_is_named_with_its_line(tmp_path: Path, line: str, message: str) -> None:
    refused(manifest(lay(tmp_path, "box.ply"), "name,file,class,mass", line), message, category="manifest")


def test_a_manifest_that_is_no_table_is_refused(tmp_path: Path) -> None:
    lay(tmp_path, "box.ply")
    refused(manifest(tmp_path, "object,path", "a,b"), "expected the columns name, file, class; got object, path")
    (tmp_path / "manifest.csv").write_bytes(b"name,file,class\n\xff\xfe\x00,x,y\n")
    refused(tmp_path, "manifest.csv: expected a table of comma-separated text")


def test_folders_that_hold_no_objects(tmp_path: Path) -> None:
    refused(tmp_path / "nowhere", "nowhere: expected a folder of objects, got nothing there")
    refused(tmp_path, r"expected meshes \(.ply, .obj, .stl, .off, .glb\), got none")
    lay(tmp_path, "a/b/box.ply", ".hidden.ply")
    refused(tmp_path, "got a/b/box.ply and no layout of YCB, KIT, Google Scanned Objects, EGAD, flat")
    lay(tmp_path, "box.ply", "a box.ply", "a_box.obj")
    refused(tmp_path / "box.ply", "box.ply: expected a folder of objects, got a file")
    refused(tmp_path, "expected each name once, got a box.ply and a_box.obj as a_box")
    (tmp_path / "a box.ply").unlink()
    refused(tmp_path, "expected a class for a_box: category=.* got neither", category="manifest")
    refused(tmp_path, "unit: expected one of auto, m, cm, mm; got inch", unit="inch")
    refused(tmp_path, "category: expected one of manifest, containers, boxes, curved; got box", category="box")
    (tmp_path / "box.yaml").write_text("name: box")
    refused(tmp_path, r"expected descriptions or meshes, got both \(box.yaml among them\)")


def test_descriptions_are_read_as_before(tmp_path: Path) -> None:
    (tmp_path / "apple.yaml").write_bytes((root() / "data/objects/apple.yaml").read_bytes())
    found = read(tmp_path, category="manifest")
    assert found.notes == [f"{tmp_path}: 1 described object"] and found.scans == []
    assert [(obj.name, obj.category) for obj in found.objects] == [("apple", "curved")]


def test_collision_pieces_are_cut_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The second time from the cache, the same to the bit; a changed setting is another entry."""
    lay(tmp_path / "meshes", "a.ply")
    kept = Cache(tmp_path / "cache")
    first, plain = read(tmp_path / "meshes", cache=kept), read(tmp_path / "meshes")
    monkeypatch.setattr(piece_cache, "collision_pieces", None)
    again = read(tmp_path / "meshes", cache=kept)
    assert first.objects[0].digest == again.objects[0].digest == plain.objects[0].digest
    assert first.scans[0].check == again.scans[0].check == plain.scans[0].check
    with pytest.raises(TypeError):
        read(tmp_path / "meshes", cache=kept, collision=settings(CollisionConfig))


def test_many_meshes_are_cut_by_several_processes_as_by_one(tmp_path: Path) -> None:
    """A card of 0.1 mm is closed, but no pieces keep its volume: what a worker refuses is told as well."""
    lay(tmp_path, *(f"{name}.ply" for name in "abcdefgh"))
    trimesh.creation.box((0.03, 0.03, 1e-4)).export(tmp_path / "card.ply")
    (tmp_path / "bad.ply").write_bytes(b"ply\n")
    one, two = (read(tmp_path, skip_bad=True, workers=workers) for workers in (1, 2))
    assert [obj.digest for obj in one.objects] == [obj.digest for obj in two.objects]
    assert one.notes == two.notes and len(one.objects) == 8
    assert "left out" in two.notes[2] and "card.ply: expected collision pieces" in two.notes[2]
    (tmp_path / "bad.ply").unlink()
    refused(tmp_path, r"card.ply: expected collision pieces .*\(skip_bad=true goes on without it\)", workers=2)


OmegaConf.register_new_resolver("slug", slug, replace=True)


def test_a_mesh_folder_is_simulated_and_trained_on(tmp_path: Path) -> None:
    """The objects that train reads have the digests that simulate noted; another unit or class is refused."""
    from spgf_torch.simulate import run as simulate
    from spgf_torch.train import run as train

    for i, width in enumerate((0.03, 0.035, 0.04, 0.045)):
        path = tmp_path / f"kit/Box{i}/meshes/Box{i}_25k.obj"
        path.parent.mkdir(parents=True)
        trimesh.creation.box((1000 * width, 60, 80)).export(path)
    objects = [f"objects={tmp_path}/kit", "category=boxes", "workers=1", "collision.samples=10000"]
    simulate(typed(SimulateConfig, composed("simulate", *objects, "candidates=10")), tmp_path / "trials")
    tiny = [
        "K=3",
        "folds=2",
        "bootstrap=100",
        "cache=off",
        "final_model=false",
        "inner_grasps=20",
        f"trials={tmp_path}/trials",
    ]
    camera = ["sensing.width=160", "sensing.height=120", "sensing.focal=144", "affordance.features_per_object=30"]
    search = ["prototypes.restarts=2", "prototypes.subsample=500"]
    run = tmp_path / "run"
    run.mkdir()
    train(typed(TrainConfig, composed("train", *objects, *tiny, *camera, *search)), run)
    assert len((run / "per_object.csv").read_text().splitlines()) == 1 + 4
    with pytest.raises(InputError, match=r"Box0\.parquet: expected"):
        train(typed(TrainConfig, composed("train", *objects, *tiny, "category=curved")), run)


def test_too_few_objects_to_learn_from(tmp_path: Path) -> None:
    """Of three objects in two folds one fold holds two, and leaves one."""
    from spgf_torch.train import run as train

    lay(tmp_path, "a.ply", "b.ply", "c.ply")
    config = typed(TrainConfig, composed("train", "K=3", f"objects={tmp_path}", "category=boxes", "folds=2"))
    with pytest.raises(
        InputError, match=r"expected two at least to learn from in each of the folds \(2\), got 1: .* 3"
    ):
        train(config, tmp_path)
