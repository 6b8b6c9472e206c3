"""The report, which compares controllers with intervals and shows where they fail.

`matchups` has policies, baselines and scenarios; `jobs` plays them; `played` has the results; `choice`, `answer`,
`tables`, `ablation` and `holds` make sentences, tables and charts; `page` writes the page.
"""
