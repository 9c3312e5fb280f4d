"""A page in the browser where a person sees plans, changes what is asked, and plans."""
