"""What a sensor would see: scenes, and the pictures that a camera takes of them."""
