"""Compiled loops over flat arrays; nothing here knows of meshes, files or users."""
