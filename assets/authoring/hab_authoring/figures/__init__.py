"""The paper's dataset figures (Figs. 6-8 and 20-22) for any dataset and episode file."""
