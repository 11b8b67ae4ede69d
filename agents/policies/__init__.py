"""Policies: their protocol, their files, their networks, and adapters for policies of other libraries."""

from agents.policies.archive import describe, load, names, pretrained, save

__all__ = ["describe", "load", "names", "pretrained", "save"]
