"""The report: a page that compares controllers, and shows under which changes of the environment they fail."""
