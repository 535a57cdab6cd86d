"""The page on scene files says what the reader takes."""

import inspect
import re
from pathlib import Path

import pytest

from springgym.model.surfaces import Contact
from springgym.scenes import load
from springgym.scenes.checks.basis import CHECKS
from springgym.scenes.plots import PLOTS
from springgym.scenes.reading import KINDS, SURFACES, started

PAGE = (Path(__file__).parents[2] / "docs" / "scenes.md").read_text()
WORDS = set(re.findall(r"\w+", PAGE))


def test_example_reads(tmp_path):
    example = re.search(r"```yaml\n(.*?)```", PAGE, re.DOTALL).group(1)
    (tmp_path / "example.yaml").write_text(example)
    plan = load(str(tmp_path / "example.yaml"))
    assert plan.scene.body.mass == 2.0
    assert plan.scene.positions[:, 2].min() == pytest.approx(0.5)


def test_every_name_is_explained():
    given = {"body", "pinned", "gravity", "surfaces", "contact"}
    keys = {key for made in (started, Contact) for key in inspect.signature(made).parameters}
    assert {"paper_damping", *(keys - given), *CHECKS, *PLOTS, *KINDS, *SURFACES} <= WORDS
