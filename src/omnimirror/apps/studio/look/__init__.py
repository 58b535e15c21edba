"""The tab that looks around in pictures, videos and streams."""
