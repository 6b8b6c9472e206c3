"""Shared by the studies and the report: results, tables, pages, charts, statistics, the slow-motion player."""
