"""Plans executed open loop in an independent physics engine, MuJoCo."""
