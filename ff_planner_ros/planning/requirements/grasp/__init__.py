"""Limits of a grasp: impulse of contact, and wrench through the grasp."""
