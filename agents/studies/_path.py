"""Put ``agents/`` on the path of a script in this folder, which imports this module before others of it."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
