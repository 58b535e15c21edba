"""Look tab: interactive views of images, videos and streams."""
