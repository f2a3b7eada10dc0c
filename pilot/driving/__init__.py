"""Driving with a trained model: from telemetry to commands."""
