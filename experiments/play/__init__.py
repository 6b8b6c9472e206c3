"""A page in the browser on which a person steers the tool. Each episode, called a try, is stored in a file."""
