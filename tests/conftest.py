"""What all tests share."""

from __future__ import annotations

import os

from hypothesis import settings

os.environ.setdefault("SDL_VIDEODRIVER", "dummy")
os.environ.setdefault("MPLBACKEND", "Agg")
# Test processes share the cores: threads of linear algebra that wait for one take many times as long.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

# The default run draws the same examples every time, so a pass means the same on every machine;
# `--hypothesis-profile=explore` draws new ones, ten times as many where a test does not say.
settings.register_profile("springgym", derandomize=True, deadline=None)
settings.register_profile("explore", derandomize=False, deadline=None, max_examples=1000)
settings.load_profile("springgym")
