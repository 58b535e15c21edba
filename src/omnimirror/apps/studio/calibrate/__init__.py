"""The tab Calibrate: boards found in pictures, and the camera that they tell."""
