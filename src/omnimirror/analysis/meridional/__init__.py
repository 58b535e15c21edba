"""What the chief ray and its neighbours do: imaging, viewpoints, virtual images, and blur against focus."""
