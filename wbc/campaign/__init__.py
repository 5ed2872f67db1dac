"""Many trials of one scenario: in processes that may die, resumed, put together in one report."""
