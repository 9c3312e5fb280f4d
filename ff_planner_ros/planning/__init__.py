"""Planning: problem, polynomial, rollout, objectives, constraints, solver, check."""
