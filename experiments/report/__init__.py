"""The report: a page that compares controllers, and shows under which changes of the environment they fail.

`matchups`: policies, baselines and scenarios. `jobs`: plays episodes. `played`: their results. `choice`, `answer`,
`tables`, `ablation` and `holds`: sentences, tables and charts. `page`: writes the page.
"""
