"""Frame-by-frame reading and writing of video files."""
