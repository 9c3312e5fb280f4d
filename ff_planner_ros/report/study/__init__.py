"""The report of a study: what became of its cases, pictures over what was varied, and plans."""
