"""Policies: what they are, on disk, and those of other people."""

from agents.policies.archive import Model, describe, load, names, pretrained, save

__all__ = ["Model", "describe", "load", "names", "pretrained", "save"]
