"""Scenes for rendering: interface, distant environments, and bundled scenes."""
