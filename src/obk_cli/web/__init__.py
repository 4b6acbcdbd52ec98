"""`obk web`: a running stack as a page in the browser."""
