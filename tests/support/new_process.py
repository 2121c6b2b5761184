"""What happens in a new Python, which has imported nothing yet."""

import subprocess
import sys


def in_a_new_process(code: str) -> str:
    """Run Python code that finds what this process finds; return what it prints."""
    path = [folder for folder in sys.path if folder]
    program = f"import sys; sys.path[:0] = {path!r}\n{code}"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    return done.stdout.strip()


def loaded_by(modules: str, *foreign: str) -> list[str]:
    """Return which of these modules are loaded after an import of `modules`."""
    told = in_a_new_process(f"import sys, {modules}\nprint(*[m for m in {foreign!r} if m in sys.modules])")
    return told.split()
