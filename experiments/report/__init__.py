"""The report: who wins, by how much, how sure that is, and whether one may believe it.

`matchups` says who meets whom, where; `measures` holds the jobs, functions that turn a controller into arrays;
`results` gathers them into what `played` describes; `answer`, `chain`, `bars`, `differences`, `learned`, `robustness`,
`weaknesses` and `shield` make numbers, tables and charts of these, each a section of the page; `page` puts it together.
"""
