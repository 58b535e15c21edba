"""What FFmpeg leaves to say in a finished MP4 or MOV."""
