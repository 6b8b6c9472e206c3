"""Shared parts of all experiments: folders of results, tables, pages, charts, statistics, the slow-motion player."""
