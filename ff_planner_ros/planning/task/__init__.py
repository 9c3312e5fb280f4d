"""A planning task with its phases and post-goal segments, and `perform`, which plans it."""
