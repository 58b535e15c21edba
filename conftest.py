"""Examples of differentiable cameras run where PyTorch is, which `make test-full` installs."""

from importlib.util import find_spec

TORCH = "src/omnimirror/torch"
collect_ignore = [] if find_spec("torch") else [f"{TORCH}/cameras.py", f"{TORCH}/differentiable_camera.py"]
