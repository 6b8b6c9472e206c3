"""A page on which a person steers the tool. Each attempt (an episode; on the page: a try) is stored in a file."""
