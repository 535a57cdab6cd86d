"""Make the scripts of agents/ and the toy environment importable."""

import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
AGENTS = HERE.parent.parent / "agents"
sys.path[:0] = [str(AGENTS), str(AGENTS / "studies"), str(HERE)]
