"""The benchmark of peers: its arguments, and what Contact-GraspNet gets of a cloud that ours sees."""

import sys
from pathlib import Path

import pytest
import torch

from spgf_torch.errors import InputError
from spgf_torch.judging.clouds import seen_as
from spgf_torch.objects.library import load_object
from spgf_torch.sensing.config import SensingConfig
from spgf_torch.settings import settings

BENCHMARKS = Path(__file__).parent / "benchmarks"
sys.path.append(str(BENCHMARKS))

from peers import arguments  # noqa: E402
from shared import contact_graspnet  # noqa: E402


@pytest.mark.parametrize("on_table", [True, False])
def test_its_points_are_those_of_the_images_that_ours_sees(on_table):
    obj = load_object(Path(__file__).parents[1] / "data" / "objects" / "soap_bar.yaml")
    sensing = settings(SensingConfig, cameras=2, width=160, height=120, focal=135.0)
    cloud = seen_as(obj, sensing, on_table, 3)
    raw = contact_graspnet.raw_cloud(obj, sensing, cloud, 3)
    on_object = raw.points[raw.on_object]
    assert raw.on_object.all() != on_table
    distance = torch.cdist(cloud.seen.texlets.positions, torch.from_numpy(on_object)).amin(1)
    assert distance.median() < 0.003  # texlets are means of these points
    with pytest.raises(RuntimeError, match="not those that were sensed"):
        contact_graspnet.raw_cloud(obj, sensing, cloud, 4)


@pytest.mark.parametrize(
    ("line", "told"),
    [
        (["objects=a"], "judge: expected judge=FOLDER"),
        (["objects=a", "judge=b", "views=x"], "views=x: expected whole numbers"),
        (["objects=a", "judge=b", "seed=0"], "seed=0: expected key=value with one of"),
        (["objects=a", "judge=b", "place=sea"], "place=sea: expected table or alone"),
    ],
)
def test_unusable_arguments_are_told_in_one_line(line, told):
    with pytest.raises(InputError, match=told):
        arguments(line)
