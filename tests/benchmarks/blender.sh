#!/usr/bin/env bash
# Makes the environment that run.py measures Blender in: tests/benchmarks/blender.sh [DIR], .bpy in the root if left out.
# Blender as a module is 370 MB to download, 1.2 GB on disk, for Python 3.11 only. On bare Linux it also needs X11's libraries
# (apt-get install libgl1 libsm6 libxfixes3 libxi6 libxkbcommon0 libxrender1).
set -euo pipefail
folder=${1:-"$(dirname "$0")/../../.bpy"}
python3.11 -m venv "$folder"
# PyPI drops old releases, which stay in Blender's own index.
"$folder/bin/pip" install -q bpy==5.0.1 ||
    "$folder/bin/pip" install -q bpy==5.0.1 --extra-index-url https://download.blender.org/pypi/
"$folder/bin/python" -c 'import bpy; print("Blender", bpy.app.version_string)'
