import subprocess
import sys
from pathlib import Path

import springgym.theory

FOLDER = Path(springgym.theory.__file__).parent


def test_theory_imports_only_checks_of_springgym_and_no_scipy():
    # springgym/__init__ is another layer: an empty parent stands in for it
    code = (
        "import pkgutil, sys, types; parent = types.ModuleType('springgym');"
        f"parent.__path__ = [{str(FOLDER.parent)!r}]; sys.modules['springgym'] = parent;"
        "import springgym.theory as own;"
        "[__import__(f'springgym.theory.{found.name}') for found in pkgutil.iter_modules(own.__path__)];"
        "assert {'numpy', 'springgym.theory.frames'} <= sys.modules.keys();"
        "assert 'scipy' not in sys.modules;"
        "others = [name for name in sys.modules if name.startswith('springgym.')];"
        "beside = {name for name in others if not name.startswith('springgym.theory')};"
        "assert beside == {'springgym.checks'}, beside"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
