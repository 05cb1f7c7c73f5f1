"""Submissions to the leaderboard: checks, repetition of episodes, and videos."""
