"""Web page that shows a drive live."""
