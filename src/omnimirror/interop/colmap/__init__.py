"""Projects of COLMAP: a mirror's pictures as those of a rig of pinholes, or of one panoramic camera."""

from .project import ColmapProject, write_colmap
from .rig import RigView, rig_of

__all__ = ["ColmapProject", "RigView", "rig_of", "write_colmap"]
