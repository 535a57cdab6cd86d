import ast
import subprocess
import sys
from pathlib import Path

import springgym.theory

FOLDER = Path(springgym.theory.__file__).parent


def test_theory_imports_nothing_of_the_simulator():
    seen = set()
    for path in FOLDER.glob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Import):
                seen |= {alias.name for alias in node.names}
            elif isinstance(node, ast.ImportFrom):
                assert node.level == 0, f"{path.name} uses a relative import"
                seen.add(node.module)
    own = {name for name in seen if name.split(".")[0] == "springgym"}
    assert "springgym.theory.frames" in own
    assert not {name for name in own if not name.startswith("springgym.theory")}


def test_importing_theory_imports_no_scipy():
    # springgym/__init__ is another layer: an empty parent stands in for it
    code = (
        "import sys, types; parent = types.ModuleType('springgym');"
        f"parent.__path__ = [{str(FOLDER.parent)!r}]; sys.modules['springgym'] = parent;"
        "import springgym.theory; assert 'numpy' in sys.modules;"
        "assert 'scipy' not in sys.modules"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
