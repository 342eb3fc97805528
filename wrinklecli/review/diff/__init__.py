"""Two assets in, their differences out: what the documents mean, and what a viewer sees over time."""
