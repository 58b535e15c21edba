"""What a sensor does: imaging characteristics, viewpoints, virtual images, blur, and all of it together."""
