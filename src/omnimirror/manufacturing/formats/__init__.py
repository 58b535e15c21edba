"""File formats of single mirrors and sensors: STEP, meshes, OpticStudio files, sag and tool paths."""
