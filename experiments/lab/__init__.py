"""What every experiment uses, once: folders of results, tables, pages, charts, statistics, the slow-motion player."""
