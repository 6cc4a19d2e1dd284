import sys
from pathlib import Path

# The suite imports test modules by path; `schemes` and others lie beside them.
sys.path.insert(0, str(Path(__file__).parent))
from host_device import cupy  # noqa: F401
