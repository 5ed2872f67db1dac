"""Surfaces, contacts and grasps against their laws and closed forms."""
