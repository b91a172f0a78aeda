"""Packages that an extra of this one brings, and the line that names the extra where one of them is missing.

What describes texlets, learns from trials and proposes grasps is always installed; what only an export, a page, a
judge's learning, a baseline, a cluster or a second engine needs is not. A package is looked up without being imported,
so that a command can ask before it loads, computes or writes anything.
"""

from __future__ import annotations

from importlib.util import find_spec

from spgf_torch.errors import InputError

# As it is imported -> its common name, and the extra in pyproject.toml.
PACKAGES = {
    "h5py": ("h5py", "export"),
    "plotly": ("plotly", "report"),
    "sklearn": ("scikit-learn", "judge"),
    "open3d": ("Open3D", "baselines"),
    "tensorboard": ("TensorBoard", "baselines"),
    "distributed": ("Dask", "cluster"),
    "xacrodoc": ("xacrodoc", "hands"),
    "collada": ("pycollada", "hands"),
    "mujoco": ("MuJoCo", "mujoco"),
    "starlette": ("Starlette", "serve"),
    "uvicorn": ("uvicorn", "serve"),
    "python_multipart": ("python-multipart", "serve"),
    "prometheus_client": ("prometheus-client", "serve"),
    "viser": ("viser", "view"),
}


def installed(package: str) -> bool:
    """Whether a package, one of `PACKAGES`, can be imported; it is not."""
    return find_spec(package) is not None


def remedy(package: str) -> str:
    """The name of a package and how to get it: `plotly (pip install 'spgf-torch[report]')`."""
    name, extra = PACKAGES[package]
    return f"{name} ({install(extra)})"


def install(extra: str) -> str:
    """The command that installs an extra."""
    return f"pip install 'spgf-torch[{extra}]'"


def needed(what: str, package: str) -> None:
    """InputError, which says how to get it, unless the package that `what` needs is installed."""
    if not installed(package):
        raise InputError(f"{what} expected {remedy(package)}, got no such package")
