"""Open-loop execution of plans in an independent physics engine."""
