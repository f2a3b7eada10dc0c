"""Gymnasium environments of the built-in simulator; importing this package registers them."""

from pilot.environments.registration import register_environments

register_environments()
