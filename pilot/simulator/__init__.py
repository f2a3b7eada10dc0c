"""Reimplementation of the Unity simulator: tracks, car, cameras and Socket.IO client, without Unity, GPU or display."""
