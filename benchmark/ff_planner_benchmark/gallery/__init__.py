"""Problems that others published: their models, their numbers, and our plans of their tasks."""
