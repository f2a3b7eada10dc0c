"""The page that shows a drive live in a browser."""
