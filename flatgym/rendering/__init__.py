"""Rendering of episodes: as arrays, in a window, and as videos. pygame is imported on first use."""

from flatgym.rendering.renderer import SIZE, Renderer, Window, check_ghost, check_mode, load_pygame, write_video

__all__ = ["SIZE", "Renderer", "Window", "check_ghost", "check_mode", "load_pygame", "write_video"]
