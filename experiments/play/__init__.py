"""A page in the browser on which a person steers the tool, and the files that store each try."""
