"""The report: which controller is better, by how much, with which confidence, and where it fails.

`matchups` names policies, baselines and scenarios; `jobs` plays them; `played` holds the results; `choice`, `answer`,
`tables`, `ablation` and `holds` make sentences, tables and charts; `page` writes them.
"""
