"""The project for Python programs and notebooks: cases, gaps and diagnoses as objects that hold pandas tables.

Thin over the rest; the commands use the same functions. `import runner` offers what other programs may rely on.
"""

import os
import sys

# nothing is drawn here; without a display GLFW would warn when MuJoCo's bindings are imported
if sys.platform == "linux" and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
    os.environ.setdefault("MUJOCO_GL", "disable")
