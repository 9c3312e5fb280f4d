"""The report of a campaign: results of its cases, plots over the varied quantities, and plans."""
