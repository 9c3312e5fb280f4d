"""A page in the browser where people look at plans, change the request and plan again."""
