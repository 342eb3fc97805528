"""Poses a glTF file with VTK's reader, which computes skin and morph targets itself.

    python tests/clients/vtk_pose.py FILE CLIP OUTPUT TIME...

CLIP is the number of the animation. OUTPUT gets (times, vertices, 3) positions as VTK gives them, as .npy: all
primitives of the scene one after another. In a process of its own, as VTK ends it where a file is not as it expects.
"""

import sys

import numpy as np
from vtkmodules.util.numpy_support import vtk_to_numpy
from vtkmodules.vtkIOGeometry import vtkGLTFReader


def main(path: str, clip: int, output: str, times: list[float]) -> None:
    reader = vtkGLTFReader()
    reader.SetFileName(path)
    reader.ApplyDeformationsToGeometryOn()
    reader.SetFrameRate(0)  # any time
    reader.UpdateInformation()
    for number in range(reader.GetNumberOfAnimations()):
        (reader.EnableAnimation if number == clip else reader.DisableAnimation)(number)
    shown = []
    for time in times:
        reader.UpdateInformation()
        reader.UpdateTimeStep(time)
        blocks = reader.GetOutput().NewIterator()
        blocks.InitTraversal()
        parts = []
        while not blocks.IsDoneWithTraversal():
            parts.append(vtk_to_numpy(blocks.GetCurrentDataObject().GetPoints().GetData()).astype(np.float64))
            blocks.GoToNextItem()
        shown.append(np.concatenate(parts))
    np.save(output, np.array(shown))


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]), sys.argv[3], [float(time) for time in sys.argv[4:]])
