"""Put ``agents/`` and the clone on the path of a script in this folder, which imports this one first."""

import sys
from pathlib import Path

AGENTS = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(AGENTS), str(AGENTS.parent)]
