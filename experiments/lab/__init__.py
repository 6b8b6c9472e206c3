"""Modules that the studies and the report share: results, tables, pages, charts, statistics, films."""
