"""The studies of the paper's supplement (S F.1 to F.6, Figs. 26 to 28), each by one command.

`study` declares what a study is, `sensors`, `left_counter` and `learning` declare the studies,
`grad_cam` is one without training. `engine` runs them, `report` writes table, figure and README.
"""
