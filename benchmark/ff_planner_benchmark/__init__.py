"""Methods compared on a data set of scenarios: who plans them, how fast, and who judges that."""
