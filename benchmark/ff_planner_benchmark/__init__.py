"""Planning methods compared on a data set of scenarios, judged by an independent scorer."""
