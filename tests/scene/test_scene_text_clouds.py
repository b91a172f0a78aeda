"""Text of other programs: which column is what, by name or by value; what cannot be told is refused."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from spgf_torch.errors import InputError
from spgf_torch.scene.config import SceneConfig
from spgf_torch.scene.files import read_cloud, read_clouds
from spgf_torch.settings import settings

LIMIT = 1000
RNG = np.random.default_rng(3)
P = RNG.random((40, 3)).round(5) * 0.3 + 0.1
N = RNG.normal(size=(40, 3))
N /= np.linalg.norm(N, axis=1, keepdims=True)
RGB = RNG.integers(0, 256, (40, 3))
I = RNG.random((40, 1)) * 200  # noqa: E741


def rows(*columns: np.ndarray, sep: str = " ") -> str:
    return "".join(sep.join(f"{value:.6f}" for value in row) + "\n" for row in np.hstack(columns))


def comma(text: str) -> str:
    return text.replace(".", ",")


UNNAMED = "columns without names"


@pytest.mark.parametrize(
    ("content", "normals", "note"),
    [
        (rows(P, RGB), False, "6 columns without names: columns 4 to 6 taken for colours"),
        (rows(P, RGB / 255), False, "columns 4 to 6 taken for colours"),
        (rows(P, N), True, ""),
        (rows(P, I, RGB), False, UNNAMED),
        (rows(P, RGB, np.full((40, 1), 255)), False, UNNAMED),
        (rows(P, RGB, N), True, "columns 7 to 9, of length 1, taken for normals"),
        (rows(P, N, RGB), True, "columns 4 to 6, of length 1, taken for normals"),
        (rows(P, N, I / 1e4), True, UNNAMED),
        ("40\n" + rows(P), False, ""),
        ("40\n" + rows(P, I), False, "column 4 taken for an intensity"),
        ("40\n\n" + rows(P, I, RGB), False, UNNAMED),
        ('"Normals:0","Normals:1","Normals:2","Points:0","Points:1","Points:2"\n' + rows(N, P, sep=","), True, ""),
        ("Points_0,Points_1,Points_2,scalars\n" + rows(P, I, sep=","), False, ""),
        ("//X,Y,Z,R,G,B,Nx,Ny,Nz\n" + rows(P, RGB, N, sep=","), True, ""),
        ("//X Y Z R G B\n40\n" + rows(P, RGB), False, ""),
        ("# z y x\n" + rows(P[:, ::-1]), False, ""),
        ("x (m), y (m), z (m)\n" + rows(P, sep=", "), False, ""),
        ("X [m] Y [m] Z [m]\n" + rows(P), False, ""),
        (",x,y,z\n" + rows(I, P, sep=","), False, ""),
        ("x;y;z\n" + comma(rows(P, sep=";")), False, "decimal commas read as points"),
        ("X\tY\tZ\n" + comma(rows(P, sep="\t")), False, "decimal commas read as points"),
        (comma(rows(P)), False, "decimal commas read as points"),
        ("x,y,z,label\n" + rows(P, sep=",").replace("\n", ",mug\n"), False, ""),
        (rows(P, sep=",").replace("\n", ",\n"), False, ""),
        ("\ufeffx,y,z\r\n" + rows(P, sep=",").replace("\n", "\r\n"), False, ""),
        (rows(P) + "1.#QNAN 1.#QNAN 1.#QNAN\n-nan(ind) 0 0\nNaN nan -nan\n", False, "3 of 43 points without a reading"),
        ("x,y,z\n" + rows(P, sep=",") + ",,\n1,,2\n", False, "2 of 42 points without a reading"),
    ],
)  # fmt: skip
def test_columns(content: str, normals: bool, note: str, tmp_path: Path) -> None:
    (tmp_path / "a.txt").write_text(content, encoding="utf-8")
    cloud = read_cloud(tmp_path / "a.txt", LIMIT)
    np.testing.assert_allclose(cloud.points, P, atol=1e-5)
    assert (cloud.normals is not None) == normals
    if cloud.normals is not None:
        np.testing.assert_allclose(cloud.normals, N, atol=1e-5)
    assert any(note in line for line in cloud.notes) if note else cloud.notes == ()


@pytest.mark.parametrize(
    ("content", "note"),
    [
        (rows(P, RGB), "6 columns without names: columns 4 to 6 taken for colours"),
        (rows(P, RGB / 255), "6 columns without names: columns 4 to 6 taken for colours"),
        (rows(P, I, RGB), "7 columns without names: columns 5 to 7 taken for colours, the others after z left out"),
        (
            rows(P, N, RGB),
            "9 columns without names: columns 4 to 6, of length 1, taken for normals, columns 7 to 9 taken for colours",
        ),
        ("//X,Y,Z,R,G,B,Nx,Ny,Nz\n" + rows(P, RGB, N, sep=","), None),
        ("blue,x,y,z,green,red\n" + rows(RGB[:, 2:], P, RGB[:, 1:2], RGB[:, :1], sep=","), None),
    ],
)
def test_colours_of_columns_that_are_clearly_some(content: str, note: str | None, tmp_path: Path) -> None:
    """Bytes, or shares of 1; by name, or where three columns in a row can be nothing else."""
    path = tmp_path / "a.xyz"
    path.write_text(content)
    cloud = read_cloud(path, LIMIT)
    assert cloud.colours is not None and cloud.colours.dtype == np.uint8
    np.testing.assert_array_equal(cloud.colours, RGB)
    np.testing.assert_allclose(cloud.points, P, atol=1e-5)
    assert cloud.notes == (() if note is None else (note,))


@pytest.mark.parametrize(("name", "coloured"), [("a.xyz", False), ("a.xyzrgb", True)])
def test_red_points_are_no_normals_in_silence(name: str, coloured: bool, tmp_path: Path) -> None:
    """A pure colour has length 1: what the file's name does not tell is told as a doubt; normals of a body are not."""
    red = np.tile([1.0, 0.0, 0.0], (len(P), 1))
    (tmp_path / name).write_text(rows(P, red))
    cloud = read_cloud(tmp_path / name, LIMIT)
    if coloured:
        np.testing.assert_array_equal(cloud.colours, 255 * red)
    assert (cloud.normals is None) == coloured
    assert cloud.notes[0].startswith(
        "columns 4 to 6 taken for colours" if coloured else "warning: columns 4 to 6 taken"
    )
    (tmp_path / "b.xyz").write_text(rows(P, N))
    assert read_cloud(tmp_path / "b.xyz", LIMIT).notes == ()


def test_colours_that_may_be_something_else_are_left_out(tmp_path: Path) -> None:
    """With a column of opacity two places may be colours; words and numbers above 255 are none. Points stay."""
    for content in (
        rows(P, RGB, np.full((40, 1), 255)),
        "x,y,z,r,g,b\n" + rows(P, RGB + 300, sep=","),
        "x,y,z,red,green,blue\n" + rows(P, sep=",").replace("\n", ",dark,dim,pale\n"),
    ):
        (tmp_path / "a.csv").write_text(content)
        cloud = read_cloud(tmp_path / "a.csv", LIMIT)
        assert cloud.colours is None
        np.testing.assert_allclose(cloud.points, P, atol=1e-5)


def test_a_point_without_a_reading_takes_its_colour_along(tmp_path: Path) -> None:
    (tmp_path / "a.txt").write_text("nan nan nan nan nan nan\n" + rows(P, RGB) + "0 0 0 7 7 7\n")
    np.save(tmp_path / "a.npy", np.hstack([P, RGB]))
    for name in ("a.txt", "a.npy"):
        np.testing.assert_array_equal(read_cloud(tmp_path / name, LIMIT).colours, RGB)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (rows(P, N, N), "expected 3 columns x y z or 6 with normals .* got 9; write a first line"),
        ("0 0\n0 0\n", "expected 3 columns x y z or 6 with normals .* got 2"),
        (rows(P, I), "got 4; write a first line such as x y z intensity"),
        (rows(P, RGB - 300), r"got lengths of .* \(colours\?"),
        ("41\n" + rows(P, I), "expected 41 rows as its first line says, got 40"),
        ("2\nwater\nO 0 0 0\nH 1 0 0\n", "expected rows of numbers"),
        ("X [ft],Y [ft],Z [ft]\n" + rows(P, sep=","), "expected one unit of x, y and z, m, cm, mm; got x in ft"),
        ("X [m],Y [m],Z [mm]\n" + rows(P, sep=","), "expected one unit of x, y and z"),
        ("x,y,z\n" + comma(rows(P, sep="|")).replace("|", ","), r"a name for each column.*got 3 names .* of 6"),
        ("lon,lat,alt\n" + rows(P, sep=","), "expected columns named x, y, z"),
        ("x,y,z,Points:0\n" + rows(P, I, sep=","), "expected columns named x, y, z .* once"),
    ],
)  # fmt: skip
def test_what_cannot_be_told_is_refused(content: str, message: str, tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text(content)
    with pytest.raises(InputError, match=message) as caught:
        read_cloud(tmp_path / "a.csv", LIMIT)
    assert "\n" not in str(caught.value)


def test_a_unit_in_the_names_is_honoured_or_contradicts(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("X [mm];Y [mm];Z [mm]\n" + rows(1000 * P, sep=";"))
    for unit, told in (("m", ("coordinates in mm, as the names of the columns state",)), ("mm", ())):
        (cloud,) = read_clouds([tmp_path / "a.csv"], settings(SceneConfig, unit=unit))
        np.testing.assert_allclose(cloud.points, P, atol=1e-6)
        assert cloud.notes == told
    with pytest.raises(InputError, match=r"expected coordinates in cm \(unit=cm\), got column names that state mm"):
        read_clouds([tmp_path / "a.csv"], settings(SceneConfig, unit="cm"))


def labels(name: str, values: np.ndarray) -> Callable[[Path], Path]:
    def write(folder: Path) -> Path:
        path = folder / name
        {"npy": np.save, "txt": np.savetxt, "npz": lambda to, array: np.savez(to, labels=array)}[path.suffix[1:]](
            path, values
        )
        return path

    return write


@pytest.mark.parametrize("name", ["l.npy", "l.txt", "l.npz"])
def test_labels_are_those_of_the_points_as_written(name: str, tmp_path: Path) -> None:
    """A point without a reading takes its label with it."""
    points = P.copy()
    points[1] = np.nan
    np.save(tmp_path / "p.npy", points)
    path = labels(name, np.arange(40) % 4 - 1)(tmp_path)
    (cloud,) = read_clouds([tmp_path / "p.npy"], settings(SceneConfig, segments=str(path)))
    np.testing.assert_array_equal(cloud.labels, np.delete(np.maximum(np.arange(40) % 4 - 1, 0), 1))
    (cloud,) = read_clouds([tmp_path / "p.npy"], settings(SceneConfig, mask=str(path)))
    np.testing.assert_array_equal(cloud.labels, np.delete(np.arange(40) % 4 != 1, 1))
    labels(name, np.ones(7))(tmp_path)
    with pytest.raises(InputError, match=r"expected \(40,\) values as .*p\.npy has, got \(7,\)"):
        read_clouds([tmp_path / "p.npy"], settings(SceneConfig, segments=str(path)))


def test_an_image_of_points_takes_an_image_of_labels(tmp_path: Path) -> None:
    np.save(tmp_path / "p.npy", P.reshape(5, 8, 3))
    image = np.arange(40).reshape(5, 8)
    np.save(tmp_path / "l.npy", image)
    (cloud,) = read_clouds([tmp_path / "p.npy"], settings(SceneConfig, segments=str(tmp_path / "l.npy")))
    assert cloud.pixels is not None
    np.testing.assert_array_equal(cloud.labels, image[cloud.pixels[:, 0], cloud.pixels[:, 1]])
