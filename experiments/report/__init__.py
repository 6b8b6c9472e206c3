"""The report: who wins, by how much, how sure that is, and where it fails.

`matchups` says who meets whom, where; `jobs` plays that and returns what `played` describes; `answer`, `ablation`,
`differences`, `holds` and `first_screen` make sentences, tables and charts of it; `page` puts them together.
"""
