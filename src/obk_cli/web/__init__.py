"""`obk web`: show a running stack as a page in the browser."""
