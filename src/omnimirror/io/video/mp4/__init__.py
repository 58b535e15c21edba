"""Metadata of finished MP4 and MOV files that FFmpeg does not write."""
