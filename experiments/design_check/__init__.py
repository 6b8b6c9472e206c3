"""Whether the search for designs finds what is there: ten seeds, and a dense grid in two numbers of a spring."""
