"""One suite of laws for every task, cost, surface and contact type, over explicit tables."""
